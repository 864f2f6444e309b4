"""`volsplat render`: one volume, one scene, image files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from volsplat.client.command.choices import Words
from volsplat.client.command.figure_options import figure_of, figure_options
from volsplat.client.command.help_page import FILES, SCENE, headed, helped, output_option, volume_argument
from volsplat.client.command.opened_volume import opened
from volsplat.client.command.render_options import SceneOptions, scene_options
from volsplat.client.command.render_outputs import Outputs, step_image_path
from volsplat.client.command.server_options import (
    Servers,
    listen_options,
    memory_option,
    server_options,
    single_option,
    spawn_option,
    trace_option,
)
from volsplat.client.command.side_console import SideConsole
from volsplat.client.figure.characters import check_words
from volsplat.client.figure.figure import BARE, Figure
from volsplat.client.image.empty_image import why_empty
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.session.frame_report import report_of, write_report
from volsplat.client.session.renderer import Refinement, Renderer, finished_whole
from volsplat.program.command_lines import PATH
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene

PICTURE_FILES = "volsplat.client.figure.figure_file"  # imported while the servers start


@helped(
    "volsplat render head.nrrd -o head.png",
    "volsplat render head.nrrd -o skull.png --preset ct-bone --rotate 30,10 --background white",
    "volsplat render head.nrrd -o head.pdf --figure --size 8.5cm --dpi 300 --background white",
)
@volume_argument
@headed(
    FILES,
    output_option("Image file: .png, .jpg, .tif, .exr, .svg or .pdf.", required=False),
    click.option("--steps-dir", type=PATH, help="Folder for every step up to --step."),
    click.option("--report", type=PATH, help="Write what each step took, as JSON."),
)
@trace_option
@headed(SCENE, click.option("--step", type=Words(Step), default="F", help="Step to draw (F)."))
@scene_options
@figure_options
@server_options
@memory_option
@single_option
@listen_options
@spawn_option
def render(
    volume: str, output: Path | None, steps_dir: Path | None, report: Path | None, step: str, **settings: Any
) -> None:
    """Draw VOLUME into an image.

    VOLUME is a file or folder in any of the formats of docs/reference/formats.md; what follows a # names a part of it,
    as in run.h5#/entry/density. Without --scene and --preset the scene is chosen from the data.
    """
    figure = figure_of(settings)
    options = SceneOptions.of(settings)
    options.scene_of(None)
    outputs = Outputs(output, steps_dir, report, figure is not None and figure.transparent)
    check_written_apart(volume, *outputs.pictures, records=[outputs.report, settings["trace"]])
    outputs.check()
    if figure is not None and output is not None:
        check_words(figure, output)
    servers = Servers.of(settings)
    servers.check_sees(volume)
    console = SideConsole()
    with opened(volume, servers, console, imports=[PICTURE_FILES]) as renderer:
        draw(renderer, options, figure, Step(step), outputs, console)


def draw(
    renderer: Renderer,
    options: SceneOptions,
    figure: Figure | None,
    last: Step,
    outputs: Outputs,
    console: PlainConsole,
) -> None:
    """Draw the last step, or all up to it where each is wanted, and write the files."""
    from volsplat.client.figure.figure_file import write_picture  # while the servers start
    from volsplat.client.figure.layout import figure_extent, sized
    from volsplat.client.figure.pointing_labels import why_unlabelled

    volume = renderer.volume
    scene = options.scene_of(volume)
    options.tell_unsuited(volume, console)
    if figure is not None:
        scene = sized(figure, scene, volume)
        if why := why_unlabelled(figure.labels, scene, volume):
            console.say(f"note: {why}")
    finished: list[Refinement] = []
    steps = renderer.refine(scene, last) if outputs.steps_dir is not None else iter([renderer.finish(scene, last)])
    for refinement in finished_whole(steps):
        finished.append(refinement)
        if outputs.steps_dir is not None:
            outputs.make_folder()
            path = step_image_path(outputs.steps_dir, refinement.step)
            write_picture(path, refinement.published.pixels, scene, volume, figure)
    if outputs.image is not None:
        write_picture(outputs.image, finished[-1].published.pixels, scene, volume, figure)
    if outputs.report is not None:
        write_report(outputs.report, report_of(volume, scene, [r.outcome for r in finished if r.outcome]))
    tell(finished[-1], scene, figure_extent(figure or BARE, scene, volume), outputs, console)


def tell(drawn: Refinement, scene: Scene, extent: tuple[int, int], outputs: Outputs, console: PlainConsole) -> None:
    """What there is now: the files, their image's `extent` in pixels, and what of a person may not expect in it."""
    tell_level(drawn, console)
    if outputs.image is not None:
        if why := why_empty(drawn.published.pixels, scene):
            console.say(f"note: {why}")
        width, height = extent
        console.say(f"{outputs.image}: {width}x{height}, {_seconds(drawn)} for step {drawn.step}")
    if outputs.steps_dir is not None:
        console.say(f"{outputs.steps_dir}: steps A to {drawn.step}")


def tell_level(drawn: Refinement, console: PlainConsole) -> None:
    """Which level of a prepared volume the image shows, and why."""
    if drawn.outcome is not None and drawn.outcome.servers.why_level:
        console.say(drawn.outcome.servers.why_level)


def _seconds(refinement: Refinement) -> str:
    assert refinement.outcome is not None
    return f"{refinement.outcome.wall_seconds:.3f} s"
