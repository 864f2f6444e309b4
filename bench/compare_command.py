"""`volsplat bench compare`: what moved between two records, and whether by more than their spread."""

from pathlib import Path

import click

from volsplat.bench.outputs import machine_words
from volsplat.bench.record import Figure, Record, read_record
from volsplat.bench.text_table import TextTable, significant, with_unit
from volsplat.protocol.errors import BadInput
from volsplat.protocol.plain_console import PlainConsole

MOVED, STAYED, UNKNOWN = "moved", "", "spread unknown"


@click.command()
@click.argument("old", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
def compare(old: Path, new: Path) -> None:
    """Compare the figures that OLD and NEW, both written by --json, have in common.

    The ratio is NEW over OLD, with what the bounds of both middle halves allow. A figure moved where its two medians
    lie outside each other's middle half. Of one sample each, the spread is unknown.
    """

    before, after = read_record(old), read_record(new)
    table = comparison(before, after)
    console = PlainConsole()
    console.print(table.rich())
    if before.machine != after.machine:
        both = f"{machine_words(before.machine)} and {machine_words(after.machine)}"
        console.say(f"Two machines: {both}.")


def comparison(old: Record, new: Record) -> TextTable:
    """A row for each figure in both. Raises BadInput where there is none."""
    before = {figure.name: figure for figure in old.figures}
    shared = [(before[figure.name], figure) for figure in new.figures if _same_kind(before.get(figure.name), figure)]
    if not shared:
        raise BadInput(f"the records of `{old.command}` and `{new.command}` have no figure in common")
    title = f"{old.command}: volsplat {old.volsplat} to {new.volsplat}"
    table = TextTable(title, ("figure", "old", "new", "new / old", ""))
    for a, b in shared:
        medians = (with_unit(one.median, one.unit) for one in (a, b))
        table.add(b.name, *medians, _ratio(a, b), _verdict(a, b))
    left_out = len(old.figures) + len(new.figures) - 2 * len(shared)
    table.caption = f"{left_out} figures stand in one record only." if left_out else ""
    return table


def moved(old: Figure, new: Figure) -> bool:
    """Whether two figures differ by more than either's spread; not so where neither has one."""
    return not (_single(old, new) or old.low <= new.median <= old.high or new.low <= old.median <= new.high)


def _single(old: Figure, new: Figure) -> bool:
    """Whether each is one sample, so that nothing is known of the spread."""
    return len(old.samples) == len(new.samples) == 1


def _verdict(old: Figure, new: Figure) -> str:
    if _single(old, new):
        return UNKNOWN
    return MOVED if moved(old, new) else STAYED


def _same_kind(old: Figure | None, new: Figure) -> bool:
    return old is not None and old.unit == new.unit


def _ratio(old: Figure, new: Figure) -> str:
    if min(old.low, old.median) <= 0:
        return "–"
    ratio = significant(new.median / old.median)
    if _single(old, new):
        return ratio
    low, high = new.low / old.high, new.high / old.low
    return f"{ratio} ({significant(low)}–{significant(high)})"
