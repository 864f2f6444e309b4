"""The tables of docs/how_it_works/reliability.md."""

import re
import statistics
from collections.abc import Sequence
from typing import TYPE_CHECKING

from support.checkout import ROOT

if TYPE_CHECKING:
    from faults.fault_runs import Aftermath

PAGE = ROOT / "docs" / "how_it_works" / "reliability.md"
HEAD = (
    "| what happens | to | faults | whole frames | marked incomplete | wrong | hangs | sessions ended "
    "| median until whole | longest |\n|---|---|---|---|---|---|---|---|---|---|\n"
)


def written(seen: "Sequence[Aftermath]", seed: int, boxed: bool) -> None:
    title, option = ("fault runs in a box", " --box") if boxed else ("fault runs", "")
    put(title, f"`python -m faults.fault_runs --count {len(seen)} --seed {seed}{option}`:\n\n{table(seen)}")


def put(title: str, told: str) -> None:
    """In its place on the page."""
    place = re.compile(rf"(?<=<!-- {title} -->\n).*?(?=<!-- end -->)", re.DOTALL)
    changed, places = place.subn(lambda _: told, PAGE.read_text(encoding="utf-8"))
    assert places == 1, f"{PAGE} has no place for {title}"
    PAGE.write_text(changed, encoding="utf-8")


def table(seen: "Sequence[Aftermath]") -> str:
    kinds = sorted({(after.fault.name, after.program.title) for after in seen})
    rows = [
        _row(kind, server, [after for after in seen if (after.fault.name, after.program.title) == (kind, server)])
        for kind, server in kinds
    ]
    return HEAD + "".join([*rows, _row("all", "", seen)])


def _row(kind: str, server: str, seen: "Sequence[Aftermath]") -> str:
    seconds = [after.seconds for after in seen if not after.ended and not after.hung]
    figures = [
        len(seen),
        sum(after.whole for after in seen),
        sum(after.incomplete for after in seen),
        sum(after.wrong for after in seen),
        sum(after.hung for after in seen),
        sum(bool(after.ended) for after in seen),
        f"{statistics.median(seconds):.2f} s" if seconds else "",
        f"{max(seconds):.2f} s" if seconds else "",
    ]
    return f"| {kind} | {server} | {' | '.join(map(str, figures))} |\n"
