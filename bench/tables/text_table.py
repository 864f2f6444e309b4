"""A table of texts, for the terminal and for Markdown."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rich import box
from rich.table import Table
from rich.text import Text

from volsplat.bench.tables.record import Figure

LONGEST_NAME = 40  # characters of a row's name that is never broken
CELL_PADDING = 3  # characters of a column beside its text: a space on either side, and what divides it from the next
LAST_EDGE = 1  # beyond the last column's own
PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))


@dataclass
class TextTable:
    """Rows of cells; the first column names the row. An empty list of cells is a line between rows."""

    title: str
    columns: Sequence[str]
    caption: str = ""
    rows: list[list[str]] = field(default_factory=list)

    def add(self, *cells: str) -> None:
        self.rows.append(list(cells))

    def rich(self, width: int) -> list[Table]:
        """The table for a terminal of `width` characters: in several, one below the other, if columns would break."""
        groups = self._column_groups(width)
        tables = [self._of_columns(columns, first=n == 0) for n, columns in enumerate(groups)]
        tables[-1].caption = self.caption or None
        return tables

    def _column_groups(self, width: int) -> list[list[int]]:
        """The columns that fit beside each other and the rows' names."""
        names, *widths = (self._column_width(n) + CELL_PADDING for n in range(len(self.columns)))
        groups: list[list[int]] = [[]]
        left = width - LAST_EDGE - names
        for n, needed in enumerate(widths, start=1):
            if groups[-1] and needed > left:
                groups.append([])
                left = width - LAST_EDGE - names
            groups[-1].append(n)
            left -= needed
        return groups

    def _column_width(self, column: int) -> int:
        cells = [self.columns[column], *(row[column] for row in self.rows if len(row) > column)]
        longest = max(len(line) for cell in cells for line in cell.split("\n"))
        return longest if column else min(longest, LONGEST_NAME)

    def _of_columns(self, columns: Sequence[int], first: bool) -> Table:
        table = Table(title=self.title if first else None, box=box.SIMPLE_HEAD, caption_justify="left")
        table.add_column(self.columns[0], overflow="fold")
        for n in columns:
            table.add_column(self.columns[n], justify="right", no_wrap=True)
        for row in self.rows:
            if row:
                table.add_row(Text(row[0]), *(Text(row[n]) if n < len(row) else "" for n in columns))
            else:
                table.add_section()
        return table

    def markdown(self) -> str:
        lines = [f"**{self.title}**", "", _line(self.columns), "|---" + "|---:" * (len(self.columns) - 1) + "|"]
        lines += [_line(row) for row in self.rows if row]
        return "\n".join([*lines, *(["", self.caption] if self.caption else [])]) + "\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"


def told(measured: Figure, scale: float = 1.0, digits: int = 3) -> str:
    """A figure with its spread, to so many significant digits."""
    median = significant(measured.median * scale, digits)
    return median if len(measured.samples) == 1 else f"{median} ({spread(measured, scale, digits)})"


def spread(measured: Figure, scale: float, digits: int) -> str:
    """The bounds of a figure's middle half."""
    return f"{significant(measured.low * scale, digits)}–{significant(measured.high * scale, digits)}"


def give_or_take(measured: Figure) -> str:
    """Half the width of a figure's middle half, as a share of its median; empty where that is unknown."""
    if len(measured.samples) == 1 or not measured.median:
        return ""
    return f"±{(measured.high - measured.low) / 2 / measured.median:.0%}"


def with_give_or_take(measured: Figure, scale: float = 1.0, digits: int = 3) -> str:
    return f"{significant(measured.median * scale, digits)} {give_or_take(measured)}".rstrip()


def significant(value: float, digits: int = 3) -> str:
    """A number in so many significant digits and without an exponent: 0.0123, 1.23, 123, 1234."""
    if value == 0:
        return "0"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{value:.{max(places, 0)}f}"


def with_unit(value: float, unit: str) -> str:
    """A number with its unit, and a prefix where there is a unit: 12.3 ms, 15.0 GB/s."""
    if not unit or value == 0:
        return significant(value)
    factor, prefix = next((pair for pair in PREFIXES if abs(value) >= pair[0]), PREFIXES[-1])
    text = f"{significant(value / factor)} {prefix}{unit}"
    return text.replace("1/s", "/s")
