"""`volsplat bench quality`: pictures measured against rays in float64, from many sides, and beside what they cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from volsplat.bench.commands.option_lists import fractions, whole_numbers
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.record import record
from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.help_page import helped
from volsplat.client.command.side_console import SideConsole
from volsplat.client.image.image_formats import check_writable
from volsplat.program.command_lines import PATH
from volsplat.protocol.description.scene import GREATEST_ZOOM
from volsplat.protocol.description.volume_name import check_is_there
from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    from volsplat.bench.quality.findings import Findings

PARTS = ("check", "marschner-lobb", "head", "slab", "turn", "times", "rings")
PLOTTED = ("marschner-lobb", "turn", "rings")
LEAST_IMAGE = 16
TURN_SIDE = 256


@dataclass(frozen=True)
class Sizes:
    """Of what is drawn."""

    volume: str | None
    zooms: Sequence[float]
    head_images: Sequence[int]
    images: Sequence[int]
    directions: int
    turn: int
    voxels: int
    repeats: int

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """What a command was given. Raises BadInput."""
        if given["volume"] is not None:
            check_is_there(given["volume"])
        return cls(
            given["volume"],
            fractions("--zooms", given["zooms"], most=GREATEST_ZOOM),
            whole_numbers("--head-images", given["head_images"], least=LEAST_IMAGE),
            whole_numbers("--images", given["images"], least=LEAST_IMAGE),
            given["directions"],
            given["turn"],
            given["voxels"],
            given["repeats"],
        )


@helped("volsplat bench quality --only head --sheet pictures.jpg")
@click.argument("volume", required=False)
@click.option("--only", multiple=True, type=click.Choice(PARTS), help="This part alone; may be given several times.")
@click.option("--zooms", default="1,2,4,8", help="Pixels a voxel of the Marschner-Lobb signal (1,2,4,8).")
@click.option("--head-images", default="512,1024", help="Sides of the head's images; 1024 takes 7 min (512,1024).")
@click.option("--images", default="512,1024", help="Sides of the square images that are timed (512,1024).")
@click.option("--directions", type=click.IntRange(min=2), default=50, help="That the slab is seen from (50).")
@click.option("--turn", type=click.IntRange(min=4), default=180, help="Views of the turn, half a degree apart (180).")
@click.option("--voxels", type=click.IntRange(8, 1024), default=256, help="A side of the shells that are timed (256).")
@click.option("--repeats", type=click.IntRange(1, 23), default=5, help="Views that are timed (5).")
@click.option("--sheet", type=PATH, help="Draw the pictures side by side into this image file.")
@output_options(plot=True)
def quality(only: Sequence[str], sheet: Path | None, **settings: Any) -> None:
    """Measure how good the pictures of steps F and G and of VTK's CPU ray caster are, with goals beside the figures.

    VOLUME is a CT in place of the head phantom, in the part that compares skin and bone with rays cast in float64.
    """
    outputs, sizes = Outputs.of(settings), Sizes.of(settings)
    if outputs.plot is not None and only and not set(only) & set(PLOTTED):
        raise BadInput(f"--plot: none of the parts asked for has a plot; ask for {', '.join(PLOTTED)} or leave it out")
    if sheet is not None:
        check_writable(sheet)
    with interrupts_held():
        from volsplat.bench.quality.side_by_side import vtk_distances
    distances = vtk_distances(SideConsole().say)
    found = [measure(sizes, distances) for measure in chosen_parts(only).values()]
    if sheet is not None:
        with interrupts_held():
            from volsplat.bench.quality.sheet import SUBJECTS, write_sheet
        write_sheet(sheet, SUBJECTS, distances)
    report(found, outputs)


Measure = Callable[[Sizes, Sequence[float]], "Findings"]


def chosen_parts(only: Sequence[str]) -> Mapping[str, Measure]:
    """Those parts, in the order of PARTS; all if none is named."""
    with interrupts_held():
        from volsplat.bench.quality.ct_head import head_findings
        from volsplat.bench.quality.frame_times import time_findings
        from volsplat.bench.quality.known_signals import ball_findings, signal_findings
        from volsplat.bench.quality.rings import ring_findings
        from volsplat.bench.quality.turn import turn_findings
        from volsplat.bench.quality.uniform_slab import slab_findings
    parts: Mapping[str, Measure] = {
        "check": lambda sizes, distances: ball_findings(distances),
        "marschner-lobb": lambda sizes, distances: signal_findings(sizes.zooms, distances),
        "head": lambda sizes, distances: head_findings(sizes.volume, None, sizes.head_images, distances),
        "slab": lambda sizes, distances: slab_findings(sizes.directions, distances),
        "turn": lambda sizes, distances: turn_findings(sizes.turn, None, TURN_SIDE),
        "times": lambda sizes, distances: time_findings(sizes.voxels, sizes.images, sizes.repeats, distances),
        "rings": lambda sizes, distances: ring_findings(),
    }
    return {name: measure for name, measure in parts.items() if not only or name in only}


def report(found: Sequence[Findings], outputs: Outputs) -> None:
    tables = [table for part in found for table in part.tables]
    figures = [figure for part in found for figure in part.figures]
    panels = [panel for part in found for panel in part.panels]
    outputs.deliver(record("quality", {}, figures), tables, panels)
