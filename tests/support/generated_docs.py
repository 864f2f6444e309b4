"""The parts of the docs that are made from the code, so that pages and code cannot drift.

A part stands between "<!-- picture: name -->" or "<!-- table: name -->" and "<!-- end -->".
"""

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

Parts = Mapping[str, Callable[[], str]]  # what makes each, by name

_PLACE = re.compile(r"(<!-- (?:picture|table): (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def remade(page: str, parts: Parts) -> str:
    """The page with all of its parts made anew. Raises KeyError for one that does not exist."""
    return _PLACE.sub(lambda place: f"{place[1]}{parts[place[2]]()}\n{place[3]}", page)


def remake(pages: Iterable[Path], parts: Parts) -> None:
    for path in pages:
        path.write_text(remade(path.read_text(encoding="utf-8"), parts), encoding="utf-8")
