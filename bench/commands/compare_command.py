"""`volsplat bench compare`: what moved between two records, and whether by more than their spread."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import msgspec

from volsplat.bench.scaling.scaling_tables import sizes_tables
from volsplat.bench.tables.outputs import Outputs, machine_words, output_options
from volsplat.bench.tables.record import Figure, Record, figure, read_record
from volsplat.bench.tables.text_table import TextTable, significant, with_unit
from volsplat.client.command.help_page import helped
from volsplat.program.command_lines import PATH
from volsplat.protocol.text.errors import BadInput

MOVED, STAYED, UNKNOWN = "moved", "", "spread unknown"


@helped("volsplat bench compare old.json new.json")
@click.argument("records", type=PATH, nargs=-1, required=True, metavar="OLD NEW [MORE]...")
@output_options()
def compare(records: tuple[Path, ...], **settings: Any) -> None:
    """Compare the figures that OLD and NEW, both written by --json, have in common.

    The ratio is NEW over OLD, with what the bounds of both middle halves allow. A figure moved where its two medians
    lie outside each other's middle half. Of one sample each, the spread is unknown.

    Runs of `bench scaling` with other numbers of servers, any number of them, are put side by side instead: --json
    then leaves all of their figures in one file.
    """
    if len(records) < 2:
        raise BadInput("give two records or more that `volsplat bench ... --json` wrote")
    outputs = Outputs.of(settings)
    read = [read_record(path) for path in records]
    if len(read) == 2 and not _other_sizes(read):
        old, new = read
        outputs.deliver(msgspec.structs.replace(new, facts=_machine_facts(read)), [comparison(old, new)])
    else:
        joined = side_by_side(read)
        outputs.deliver(joined, sizes_tables(joined.figures))


def _other_sizes(records: Sequence[Record]) -> bool:
    """Whether each record has a number of servers of its own."""
    sizes = [{one.servers for one in record.figures if one.servers} for record in records]
    return all(sizes) and all(a.isdisjoint(b) for a, b in pairwise(sizes))


def side_by_side(records: Sequence[Record]) -> Record:
    """All figures of runs of several sizes; those of one name are of one quantity, so their samples are put together.

    Raises BadInput if they are not runs of `bench scaling`.
    """
    others = {record.command for record in records} - {"scaling"}
    if others:
        raise BadInput(f"only records of `scaling` stand side by side, not of {', '.join(sorted(others))}; give two")
    by_name: dict[str, list[Figure]] = defaultdict(list)
    for record in records:
        for one in record.figures:
            by_name[one.name].append(one)
    figures = [_joined(same) for same in by_name.values()]
    facts = {name: fact for record in records for name, fact in record.facts.items()}
    newest = records[-1]
    return msgspec.structs.replace(newest, facts={**facts, **_machine_facts(records)}, figures=tuple(figures))


def _joined(same: Sequence[Figure]) -> Figure:
    first = same[0]
    samples = [sample for one in same for sample in one.samples]
    return figure(first.name, first.unit, samples, first.setting, first.servers)


def _machine_facts(records: Sequence[Record]) -> dict[str, str]:
    machines = list(dict.fromkeys(machine_words(record.machine) for record in records))
    return {"machines": " and ".join(machines)} if len(machines) > 1 else {}


def comparison(old: Record, new: Record) -> TextTable:
    """A row for each figure in both. Raises BadInput if there is none."""
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
    """Whether two figures differ by more than either's spread; not so if neither has one."""
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
