"""Parts of a file or folder, each a volume of its own: what readers ask a person to choose from."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from volsplat.protocol.text.errors import BadInput


class Part(NamedTuple):
    """What names it after the `#`, and what it is, in words."""

    part: str
    told: str


class PartNeeded(BadInput):
    """One of the parts must be named."""

    def __init__(self, line: str, parts: Iterable[Part]) -> None:
        super().__init__(line)
        self.parts = tuple(parts)


def numbered(count: int, what: str, key: str = "", names: Sequence[str] = ()) -> list[Part]:
    """Parts that are numbered from 0, by a key if one is needed, with the `names` that they have."""
    named = [f": {name}" if name else "" for name in names] or [""] * count
    return [
        Part(f"{key}={n}" if key else str(n), f"{what} {n} of 0 to {count - 1}{name}") for n, name in enumerate(named)
    ]
