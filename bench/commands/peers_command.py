"""`volsplat bench peers`: the same pictures by volsplat and by VTK's CPU ray caster, in turns within one run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from volsplat.bench.commands.option_lists import fractions, whole_numbers
from volsplat.bench.subject import Shares, Subject, shares, subject_options, volume_file, volume_words
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure, record
from volsplat.bench.tables.text_table import TextTable, told
from volsplat.bench.timing import interleaved, ratios, wall_seconds
from volsplat.bench.views import around, seen
from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.help_page import helped
from volsplat.client.command.side_console import SideConsole
from volsplat.client.session.renderer import Renderer
from volsplat.program.command_lines import PATH
from volsplat.program.extras import need
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    from volsplat.bench.peers.contenders import Contender

PICTURED = 4  # of the views: compared, and saved where a folder is given
COARSEST = 4.0  # voxels between two samples of a ray


@dataclass(frozen=True)
class Run:
    """The contenders' seconds at one image size, view by view, and how alike the pictures are."""

    size: int
    seconds: Mapping[tuple[str, int], list[float]]  # of contender and threads
    likeness: Mapping[str, list[float]]  # SSIM of volsplat and each peer
    shares: Shares


@helped("volsplat bench peers head.nrrd", "volsplat bench peers --phantom shells:256 --threads 1")
@subject_options
@click.option("--images", default="512,1024", help="Sides of the square images, pixels (512,1024).")
@click.option("--views", type=click.IntRange(min=1), default=24, help="Once around the volume (24).")
@click.option("--threads", default="1,2", help="Of each renderer (1,2).")
@click.option("--distances", default="1,0.5", help="Voxels between two samples of VTK's rays (1,0.5).")
@click.option("--pictures", type=PATH, help="Save both pictures, side by side, in this folder.")
@output_options()
def peers(images: str, views: int, threads: str, distances: str, pictures: Path | None, **settings: Any) -> None:
    """Draw VOLUME by volsplat and by VTK's CPU ray caster, shaded, and compare their times and pictures.

    Both have the same volume, tables, views, image size and threads. A time is that of one frame, from asking to the
    image in memory. Ratios are taken view by view.
    """
    subject = Subject.of(settings)
    sizes, counts = whole_numbers("--images", images, least=16), whole_numbers("--threads", threads, most=256)
    steps = fractions("--distances", distances, most=COARSEST)
    outputs = Outputs.of(settings)
    if pictures is not None:
        make_folder(pictures)
    need("vtkmodules", "volsplat bench peers", "bench")
    with interrupts_held():
        from volsplat.bench.peers.contenders import opened_contenders

    console = SideConsole()
    with console.status("starting") as status, volume_file(subject, status.update) as path:
        with opened_contenders(path, lambda r: subject.scene_of(r.volume), counts, steps, status.update) as opened:
            status.stop()
            renderer, shown, contenders = opened
            known = renderer.volume
            rotations = around(views)
            runs = []
            for size in sizes:
                scenes = [
                    known.settled(seen(shown, known.description.geometry, turned, (size, size))) for turned in rotations
                ]
                runs.append(measured(renderer, contenders, scenes, size, pictures))
    report(runs, steps, volume_words(known), subject.tables, views, outputs)


def make_folder(folder: Path) -> None:
    """Raises BadInput."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder}: cannot make this folder: {error.strerror}") from error


def measured(
    renderer: Renderer, contenders: Sequence[Contender], scenes: Sequence[Scene], size: int, pictures: Path | None
) -> Run:
    """Every contender draws every view, in turns.

    What is timed is a frame among frames, as where a person turns the volume: each time the view before it is drawn
    first, since another contender has had the caches meanwhile.
    """
    before = dict(zip(scenes, [scenes[-1], *scenes], strict=False))
    likeness: dict[str, list[float]] = {}
    pictured = scenes[:: -(-len(scenes) // PICTURED)]

    def drawing(contender: Contender) -> Callable[[Scene], float]:
        def timed(scene: Scene) -> float:
            contender.draw(before[scene])
            return wall_seconds(lambda: contender.draw(scene))

        return timed

    with shown_progress(f"{size} x {size} pixels", len(scenes)) as step:

        def drawn(scene: Scene) -> None:
            if scene in pictured:
                path = pictures / f"{size}-view-{scenes.index(scene):02d}.png" if pictures is not None else None
                compare_pictures(contenders, likeness, path)
            step()

        seconds = interleaved({(c.name, c.threads): drawing(c) for c in contenders}, scenes, drawn)
    return Run(size, seconds, likeness, shares(renderer, scenes[0]))


def compare_pictures(contenders: Sequence[Contender], likeness: dict[str, list[float]], path: Path | None) -> None:
    """Note the SSIM of the first contender, ours, and each of VTK's; save both side by side."""
    import torch

    from volsplat.bench.peers.contenders import VTK
    from volsplat.bench.ssim import luminance, ssim
    from volsplat.client.image.image_file import write_pixels

    own = contenders[0].picture()
    other: dict[str, torch.Tensor] = {c.name: c.picture() for c in reversed(contenders) if c.name.startswith(VTK)}
    for name, picture in other.items():
        likeness.setdefault(name, []).append(ssim(luminance(own), luminance(picture)))
    if path is not None:
        row = [image[..., :3] for image in (own, *reversed(other.values()))]  # over black
        write_pixels(path, torch.cat(row, dim=1))


def report(
    runs: Sequence[Run], distances: Sequence[float], volume: str, tables: str, views: int, outputs: Outputs
) -> None:
    """The tables, and the files that are wanted."""
    from volsplat.bench.peers.contenders import vtk_name

    per_voxel = vtk_name(max(distances))
    shown, figures, facts = [], [], {"volume": volume, "tables": tables, "views": f"{views} once around"}
    for run in runs:
        table = TextTable(
            f"{volume}, {run.size} x {run.size} pixels: milliseconds a frame",
            ("", "threads", "milliseconds", "faster"),
            f"{run.shares}. Median of {views} views (their middle half). faster: than {per_voxel}, with as many "
            "threads. VTK at d voxel: a sample every d voxel of a ray. With n threads, n map/shade servers.",
        )
        for (name, threads), seconds in run.seconds.items():
            label = f"{run.size}x{run.size}, {name}, {threads} threads"
            taken = figure(label, "s", seconds)
            faster = figure(f"{label}: faster than {per_voxel}", "", ratios(run.seconds[per_voxel, threads], seconds))
            table.add(name, str(threads), told(taken, 1e3), told(faster))
            figures += [taken, faster]
        for name, values in run.likeness.items():
            alike = figure(f"{run.size}x{run.size}, SSIM of volsplat and {name}", "", values)
            facts[f"SSIM at {run.size}x{run.size}, {name}"] = told(alike)
            figures.append(alike)
        figures += _share_figures(run)
        facts[f"shares at {run.size}x{run.size}"] = str(run.shares)
        shown.append(table)
    outputs.deliver(record("peers", facts, figures), shown)


def _share_figures(run: Run) -> list[Figure]:
    return [
        figure(f"{run.size}x{run.size}, share of voxels visible", "", [run.shares.visible]),
        figure(f"{run.size}x{run.size}, share of visible hidden", "", [run.shares.hidden]),
    ]
