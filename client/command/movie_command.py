"""`volsplat movie`: a volume once around, or from key scene to key scene, as a film or as numbered images."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, get_args

import click

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.choices import Words
from volsplat.client.command.figure_options import figure_of, figure_options
from volsplat.client.command.help_page import FILES, SCENE, SERVERS, headed, helped, volume_argument
from volsplat.client.command.opened_volume import (
    check_found,
    memory_option,
    opened_quietly,
    server_options,
    servers_from_options,
    trace_option,
)
from volsplat.client.command.progress_bar import shown_progress
from volsplat.client.command.render_options import SceneOptions, scene_options
from volsplat.client.command.side_console import SideConsole
from volsplat.client.figure.characters import check_words
from volsplat.client.figure.figure import BARE
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.movie.key_frames import TurningAxis, check_key_count, key_framed, turntable
from volsplat.client.movie.movie_formats import MOST_FRAMES, check_clear, check_movie_writable, movie_files
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.text.errors import BadInput


@helped(
    "volsplat movie head.nrrd -o turntable.mp4",
    "volsplat movie head.nrrd -o flight.webm --key front.toml --key inside.png --frames 240",
)
@volume_argument
@headed(
    FILES,
    click.option(
        "-o",
        "--output",
        type=click.Path(path_type=Path),
        required=True,
        help="Film (.mp4 or .webm, by ffmpeg), or a folder for numbered PNG images.",
    ),
)
@trace_option
@headed(
    "How it moves",
    click.option(
        "--frames", type=click.IntRange(1, MOST_FRAMES), default=120, help="How many images make the movie (120)."
    ),
    click.option("--rate", type=click.IntRange(1, 240), default=30, help="Images a second, in a film (30)."),
    click.option("--axis", type=Words(get_args(TurningAxis)), help="What the volume turns about (screen-y)."),
    click.option(
        "--key",
        "keys",
        multiple=True,
        type=click.Path(path_type=Path),
        metavar="SCENE",
        help="Move from key to key instead, evenly in time; give it twice or more. Scene TOML, or an image of "
        "volsplat's.",
    ),
)
@headed(SCENE, click.option("--step", type=Words(Step), default="F", help="Step to draw (F)."))
@scene_options
@figure_options
@server_options
@memory_option
@headed(SERVERS, click.option("--single", is_flag=True, help="One process, no servers: the same images."))
def movie(
    volume: str,
    output: Path,
    frames: int,
    rate: int,
    axis: TurningAxis | None,
    keys: tuple[Path, ...],
    step: str,
    workers: int,
    splat_servers: int,
    threads: int,
    silence: float,
    tls: bool | None,
    cluster: Path | None,
    memory: str | None,
    trace: Path | None,
    single: bool,
    **settings: Any,
) -> None:
    """Turn VOLUME once around, or move through key scenes, into a movie.

    VOLUME is a file or folder in any of the formats of docs/reference/formats.md; what follows a # names a part of it,
    as in run.h5#/entry/density. Without --scene and --preset the scene is chosen from the data; what a key leaves out
    is taken from that scene, and the other options hold for every key. A turn can be looped. The movie
    appears under its name when it is complete.
    """
    figure = figure_of(settings)
    if figure is not None and figure.transparent:
        check_clear(output)
    options = SceneOptions.of(settings)
    if keys and axis is not None:
        raise BadInput("--axis is what one scene turns about, --key gives several; leave out one of them")
    check_found(volume, True, cluster)
    check_written_apart(volume, *movie_files(output, frames), records=[trace])
    if keys:
        check_key_count(len(keys), frames)
    options.key_scenes(None, keys)
    options.scene_of(None)
    check_movie_writable(output)
    if figure is not None:
        check_words(figure, output)
    servers = servers_from_options(
        workers,
        splat_servers,
        threads,
        None,
        None,
        single,
        memory,
        cluster=cluster,
        silence=silence,
        tls=tls,
        trace=trace,
    )

    def scenes_of(known: SurveyedVolume) -> list[Scene]:
        geometry = known.description.geometry

        def made_ready(scene: Scene) -> Scene:
            return known.settled(scene if figure is None else sized(figure, scene, known))

        if keys:
            ready = [made_ready(key) for key in options.key_scenes(known, keys)]
            return key_framed(ready, geometry, frames, known.automatic_window)
        return turntable(made_ready(options.scene_of(known)), geometry, frames, axis or "screen-y")

    console = SideConsole()
    began = time.perf_counter()
    with shown_progress(frames, console) as (say, done):
        with opened_quietly(volume, servers, True, say, console) as renderer:
            with interrupts_held():  # imported when every server works
                from volsplat.client.figure.frame_figure import FrameFigure
                from volsplat.client.figure.layout import sized
                from volsplat.client.movie.movie import write_movie
            scenes = scenes_of(renderer.volume)
            write_movie(renderer, scenes, output, rate, done, lambda: False, Step(step), figure)
            known = renderer.volume
            width, height = FrameFigure(figure or BARE, scenes, renderer.volume).extent
    seconds = time.perf_counter() - began
    options.tell_unsuited(known, console)
    console.say(f"{output}: {frames} images of {width}x{height}, {seconds:.1f} s")
