"""Lines over numbers as a PNG file, by matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.program.extras import need
from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Points = Sequence[tuple[float | str, float]]  # x as a number or a name, y

INCHES = (6.0, 4.2)  # of a panel
COLUMNS = 2
DOTS_PER_INCH = 110
MOST_INSIDE = 7  # lines of a legend that lies over the axes; a longer one would hide lines
LEGEND_COLUMNS = 3


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    x: str
    y: str
    lines: Mapping[str, Points]
    logarithmic: bool = False  # y
    faint: Sequence[str] = ()  # lines that stand behind the others


def check_plot(path: Path) -> None:
    """Raise BadInput if write_plot could not."""
    need("matplotlib", "--plot", "bench")
    if path.suffix.lower() != ".png":
        raise BadInput(f"{path}: a plot is a PNG file; end its name in .png")


def write_plot(path: Path, title: str, panels: Sequence[Panel]) -> None:
    """Draw the panels side by side. Raises BadInput."""
    with interrupts_held():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    columns = min(len(panels), COLUMNS)
    rows = -(-len(panels) // columns)
    sheet = Figure(figsize=(INCHES[0] * columns, INCHES[1] * rows), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(sheet)
    sheet.suptitle(title, fontsize=8)
    for n, panel in enumerate(panels):
        _draw(sheet.add_subplot(rows, columns, n + 1), panel)
    try:
        sheet.savefig(path, format="png")
    except OSError as error:
        raise BadInput(f"{path}: cannot write the plot: {error.strerror}") from error


def _draw(axes: Axes, panel: Panel) -> None:
    from matplotlib import rcParams
    from matplotlib.rcsetup import cycler

    axes.set_prop_cycle(cycler(linestyle=["-", ":"]) * rcParams["axes.prop_cycle"])  # more lines than colours
    for name in panel.faint:
        points = panel.lines[name]
        axes.plot([x for x, _ in points], [y for _, y in points], color="0.6", linestyle="--", marker=".")
        axes.annotate(name, points[-1], xytext=(4, 0), textcoords="offset points", fontsize=7, color="0.4")
    for name, points in panel.lines.items():
        if name not in panel.faint:
            axes.plot([x for x, _ in points], [y for _, y in points], marker="o", markersize=3.5, label=name)
    axes.set_title(panel.title, fontsize=10)
    axes.set_xlabel(panel.x)
    axes.set_ylabel(panel.y)
    if panel.logarithmic:
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
    axes.margins(x=0.17 if panel.faint else 0.05)
    axes.grid(alpha=0.3)
    if len(panel.lines) - len(panel.faint) > MOST_INSIDE:
        axes.legend(fontsize=8, ncols=LEGEND_COLUMNS, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    elif len(panel.lines) > len(panel.faint):
        axes.legend(fontsize=8)
