"""`volsplat gallery`: the sixteen images of the paper's colour plates."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.choices import Words
from volsplat.client.command.help_page import helped
from volsplat.client.command.opened_volume import opened_quietly
from volsplat.client.command.progress_bar import shown_progress
from volsplat.client.command.server_options import Servers, server_options
from volsplat.client.command.side_console import SideConsole
from volsplat.client.session.renderer import Renderer
from volsplat.program.command_lines import PATH
from volsplat.protocol.description.refinement_steps import Step


@helped("volsplat gallery plates", "volsplat gallery plates --data measured --size 1024")
@click.argument("out", type=PATH)
@click.option(
    "--data",
    type=PATH,
    help="Folder with measured volumes; phantoms stand for those that are not in it.",
)
@server_options
@click.option("--size", type=click.IntRange(64, 4096), default=512, metavar="PIXELS", help="Of an image's side (512).")
@click.option(
    "--step", type=Words([Step.F, Step.G]), default="F", help="The step for what the paper draws in step F (F)."
)
def gallery(out: Path, data: Path | None, size: int, step: str, **settings: Any) -> None:
    """Draw the sixteen images of the paper's colour plates into the folder OUT, and its four plates.

    Every image comes from a scene file: client/gallery/scenes in a checkout and in the installed package. With
    --data, volumes are taken from that folder where it has them; volsplat makes all others itself.
    """
    servers = Servers.of(settings)
    console = SideConsole()
    began = time.perf_counter()
    with interrupts_held():
        from volsplat.client.gallery.drawing import draw_gallery, gallery_folder
        from volsplat.client.gallery.plates import IMAGES, PLATES
    with gallery_folder(out, data), shown_progress(len(IMAGES), console) as (say, done):

        @contextmanager
        def opened(volume: str) -> Iterator[Renderer]:
            with opened_quietly(volume, servers, say, console) as renderer:
                for warning in renderer.volume.description.warnings:
                    console.say(f"note: {warning}")
                yield renderer

        draw_gallery(out, data, size, opened, say, done, Step(step))
    seconds = time.perf_counter() - began
    console.say(f"{out}: {len(IMAGES)} images and {len(PLATES)} plates, {seconds:.1f} s")
