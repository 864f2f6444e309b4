"""What one part of the comparison finds: a table with goals beside its numbers, figures for the record, and plots."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from volsplat.bench.tables.plot import Panel
from volsplat.bench.tables.record import Figure, figure
from volsplat.bench.tables.text_table import TextTable, significant

GOAL_COLUMNS = ("goal", "reached")


@dataclass(frozen=True)
class Goal:
    words: str
    reached: bool

    @property
    def cells(self) -> tuple[str, str]:
        return self.words, "yes" if self.reached else "no"


@dataclass(frozen=True)
class Row:
    """A measure of each contender, and what is to be reached."""

    name: str
    values: Mapping[str, float]
    goal: Goal | None = None


@dataclass(frozen=True)
class Findings:
    tables: Sequence[TextTable]
    figures: Sequence[Figure]
    panels: Sequence[Panel] = ()


def findings(
    title: str, measure: str, unit: str, rows: Sequence[Row], caption: str, panels: Sequence[Panel] = ()
) -> Findings:
    """One table with a column for each contender; `measure` names what is in it, in the record as well."""
    names = list(dict.fromkeys(name for row in rows for name in row.values))
    table = TextTable(f"{title}: {measure}", ("", *names, *GOAL_COLUMNS), caption)
    for row in rows:
        cells = (significant(row.values[name], 4) if name in row.values else "" for name in names)
        table.add(row.name, *cells, *(row.goal.cells if row.goal else ("", "")))
    figures = [
        figure(f"{title}, {row.name}: {measure} of {name}", unit, [value])
        for row in rows
        for name, value in row.values.items()
    ]
    return Findings([table], figures, panels)
