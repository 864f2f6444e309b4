"""Lines over numbers as a PNG file, by matplotlib."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from volsplat.bench.extra import need
from volsplat.client.interrupts import interrupts_held
from volsplat.protocol.errors import BadInput

Points = Sequence[tuple[float | str, float]]  # x as a number or a name, y

INCHES = (6.0, 4.2)  # of a panel
DOTS_PER_INCH = 110


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
    """Raise BadInput where write_plot could not."""
    need("matplotlib", "--plot")
    if path.suffix.lower() != ".png":
        raise BadInput(f"{path}: a plot is a PNG file; end its name in .png")


def write_plot(path: Path, title: str, panels: Sequence[Panel]) -> None:
    """Draw the panels side by side. Raises BadInput."""
    with interrupts_held():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    sheet = Figure(figsize=(INCHES[0] * len(panels), INCHES[1]), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(sheet)
    sheet.suptitle(title, fontsize=9)
    for n, panel in enumerate(panels):
        axes = sheet.add_subplot(1, len(panels), n + 1)
        for name, points in panel.lines.items():
            (line,) = axes.plot([x for x, _ in points], [y for _, y in points], marker="o", markersize=3.5, label=name)
            if name in panel.faint:
                line.set(color="0.6", linestyle="--", zorder=1)
        axes.set_title(panel.title, fontsize=10)
        axes.set_xlabel(panel.x)
        axes.set_ylabel(panel.y)
        if panel.logarithmic:
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        if panel.lines:
            axes.legend(fontsize=8)
    try:
        sheet.savefig(path, format="png")
    except OSError as error:
        raise BadInput(f"{path}: cannot write the plot: {error.strerror}") from error
