"""`volsplat export`: what is visible as 3-D Gaussians, or a surface as a mesh, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from volsplat.client.command.choices import Words
from volsplat.client.command.help_page import FILES, SERVERS, headed, helped, output_option, volume_argument
from volsplat.client.command.opened_volume import tell_notes
from volsplat.client.command.progress_bar import shown_progress
from volsplat.client.command.render_options import SceneOptions, scene_options
from volsplat.client.command.server_options import own_memory_option
from volsplat.client.command.side_console import SideConsole
from volsplat.client.export.export import check_export, write_export
from volsplat.client.export.view_light import LIGHTS, Light
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.session.single import SingleProcess
from volsplat.program.server_process import THREADS
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.volume_name import check_is_there

PROGRESS_STEPS = 100


@helped(
    "volsplat export head.nrrd -o head.ply --preset ct-skin --rotate front",
    "volsplat export head.nrrd -o skull.stl --level 1200",
)
@volume_argument
@headed(
    FILES,
    output_option("Gaussians (.ply), or a mesh (.stl, .glb or .obj; extra [export])."),
)
@headed(
    "What is exported",
    click.option("--level", type=float, help="A mesh's value, in the volume's own units (the opacity table's edge)."),
    click.option("--every", type=click.IntRange(min=1), default=1, help="Take every so many voxels on each axis (1)."),
    click.option(
        "--light",
        type=Words(LIGHTS),
        help="Gaussians as lit for each viewer, or for the scene's view, or evenly (viewer).",
    ),
)
@scene_options
@headed(SERVERS, click.option("--threads", type=THREADS, default=usable_cores(), help="Threads (cores)."))
@own_memory_option
def export(
    volume: str,
    output: Path,
    level: float | None,
    every: int,
    light: Light | None,
    threads: int,
    memory: int | None,
    **settings: Any,
) -> None:
    """Write what is visible of VOLUME for other programs.

    A .ply file holds the visible voxels as 3-D Gaussians, for viewers of Gaussian splats; .stl, .glb and .obj files a
    surface of one value. Positions are the volume's own, as in mm. The scene decides what is visible, as it does for
    `volsplat render`. One process does it, without servers.
    """
    check_export(output, level, light)
    options = SceneOptions.of(settings)
    options.scene_of(None)
    check_is_there(volume)
    check_written_apart(volume, output)
    console = SideConsole()
    with shown_progress(PROGRESS_STEPS, console) as (say, done):
        with SingleProcess(volume, threads=threads, memory=memory, on_progress=say) as single:
            single.volume.check_has_values()
            tell_notes(single.volume, console)
            options.tell_unsuited(single.volume, console)
            say(f"writing {output.name}")
            scene = options.scene_of(single.volume)
            held = write_export(
                single, scene, output, level, every, light, lambda share: done(int(PROGRESS_STEPS * share))
            )
    if single.why_level:
        console.say(single.why_level)
    console.say(f"{output}: {held}")
