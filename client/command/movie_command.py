"""`volsplat movie`: a volume once around, or from key scene to key scene, as a film or as numbered images."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Self, get_args

import click

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.choices import Words
from volsplat.client.command.figure_options import figure_of, figure_options
from volsplat.client.command.help_page import FILES, SCENE, headed, helped, output_option, volumes_argument
from volsplat.client.command.opened_volume import opened_quietly, servers_kept
from volsplat.client.command.progress_bar import shown_progress
from volsplat.client.command.render_options import SceneOptions, scene_options
from volsplat.client.command.server_options import Servers, memory_option, server_options, single_option, trace_option
from volsplat.client.command.side_console import SideConsole
from volsplat.client.figure.characters import check_words
from volsplat.client.figure.figure import BARE, Figure
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.movie.key_frames import TurningAxis, check_key_count, key_framed, turntable
from volsplat.client.movie.movie_formats import MOST_FRAMES, check_clear, check_movie_writable, movie_files
from volsplat.client.movie.volumes_in_turn import OWN_STRENGTHS, check_at_hand, renderers_in_turn, shows_strengths
from volsplat.client.session.renderer import Renderer
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.command_lines import PATH
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

FRAMES = 120


@helped(
    "volsplat movie head.nrrd -o turntable.mp4",
    "volsplat movie head.nrrd -o flight.webm --key front.toml --key inside.png --frames 240",
    "volsplat movie 'heart.nii.gz#'{0..19} -o heartbeat.mp4 --rate 20",
)
@volumes_argument
@headed(
    FILES,
    output_option("Film (.mp4 or .webm, by ffmpeg), or a folder for numbered PNG images."),
)
@trace_option
@headed(
    "How it moves",
    click.option(
        "--frames",
        type=click.IntRange(1, MOST_FRAMES),
        help="How many images make the movie (120; of several volumes one each).",
    ),
    click.option("--rate", type=click.IntRange(1, 240), default=30, help="Images a second, in a film (30)."),
    click.option(
        "--axis", type=Words(get_args(TurningAxis)), help="What a volume turns about (screen-y); have several turn."
    ),
    click.option(
        "--key",
        "keys",
        multiple=True,
        type=PATH,
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
@single_option
def movie(volumes: tuple[str, ...], output: Path, rate: int, step: str, **settings: Any) -> None:
    """Turn VOLUME once around, or move through key scenes, into a movie. Or show several volumes one after another.

    VOLUME is a file or folder in any of the formats of docs/reference/formats.md; what follows a # names a part of it,
    as in run.h5#/entry/density. Without --scene and --preset the scene is chosen from the data; what a key leaves out
    is taken from that scene, and the other options hold for every key. A turn can be looped. Several volumes are steps
    in time, on one grid: all are shown with the scene, density window and view of the first. The movie appears under
    its name when it is complete.
    """
    motion = Motion.of(settings, volumes)
    servers = Servers.of(settings)
    for volume in volumes:
        servers.check_sees(volume)
        if servers.here:
            check_at_hand(volume)
        check_written_apart(volume, *movie_files(output, motion.frames), records=[servers.trace])
    if servers.trace is not None and len(volumes) > 1:
        raise BadInput("--trace records the servers of one volume; leave it out")
    check_output(output, motion.figure)
    console = SideConsole()
    began = time.perf_counter()

    def tell(note: str) -> None:
        console.say(f"note: {note}")

    with shown_progress(motion.frames, console) as (say, done), servers_kept(servers, say, console) as kept:

        def opened(volume: str) -> AbstractContextManager[Renderer]:
            return opened_quietly(volume, kept, say, console)

        with closing(renderers_in_turn(volumes, motion.frames, opened, tell)) as renderers:
            first = next(renderers)
            known = first.volume
            if motion.shows_own_strengths(known):
                tell(OWN_STRENGTHS)
            width, height = draw(chain([first], renderers), known, motion, Step(step), output, rate, done)
    seconds = time.perf_counter() - began
    motion.options.tell_unsuited(known, console)
    if why := motion.why_unlabelled(known):
        tell(why)
    console.say(f"{output}: {motion.frames} images of {width}x{height}, {seconds:.1f} s")


@dataclass(frozen=True)
class Motion:
    """What moves in a movie: one scene once around, or from key to key; or a scene stays, and volumes change."""

    figure: Figure | None
    options: SceneOptions
    frames: int
    keys: Sequence[Path]
    axis: TurningAxis | None
    in_turn: bool  # several volumes are shown, one after another

    @classmethod
    def of(cls, given: dict[str, Any], volumes: Sequence[str]) -> Self:
        """What a command was given; `figure_of` takes its part out of that. Raises BadInput."""
        figure, in_turn = figure_of(given), len(volumes) > 1
        frames = given["frames"] or (len(volumes) if in_turn else FRAMES)
        motion = cls(figure, SceneOptions.of(given), frames, given["keys"], given["axis"], in_turn)
        if frames < len(volumes):
            raise BadInput(
                f"--frames {frames} shows not all of the {len(volumes)} volumes; give one frame each or more"
            )
        if motion.keys and motion.axis is not None:
            raise BadInput("--axis is what one scene turns about, --key gives several; leave out one of them")
        if motion.keys:
            check_key_count(len(motion.keys), motion.frames)
        motion.options.key_scenes(None, motion.keys)
        motion.options.scene_of(None)
        return motion

    def scenes_of(self, known: SurveyedVolume) -> list[Scene]:
        """One for each frame. Raises BadInput."""
        geometry = known.description.geometry
        if self.keys:
            ready = [self._made_ready(key, known) for key in self.options.key_scenes(known, self.keys)]
            return key_framed(ready, geometry, self.frames, known.automatic_window)
        begun = self._made_ready(self.options.scene_of(known), known)
        if self.in_turn and self.axis is None:
            return [begun] * self.frames
        return turntable(begun, geometry, self.frames, self.axis or "screen-y")

    def why_unlabelled(self, known: SurveyedVolume) -> str:
        """One line that names the labels that no frame shows; empty if there are none."""
        from volsplat.client.figure.pointing_labels import why_never_labelled

        labels = () if self.figure is None else self.figure.labels
        return why_never_labelled(labels, self.scenes_of(known), known) if labels else ""

    def shows_own_strengths(self, known: SurveyedVolume) -> bool:
        """Whether volumes are shown by what is scaled for each by itself."""
        alike = not self.in_turn or known.description.second_scalar is not None
        return not alike and any(map(shows_strengths, self.scenes_of(known)))

    def _made_ready(self, scene: Scene, known: SurveyedVolume) -> Scene:
        from volsplat.client.figure.layout import sized  # when every server works

        ready = scene if self.figure is None else sized(self.figure, scene, known, self.in_turn)
        settled = known.settled(known.fitted_to_turn(ready))
        return known.windowed(settled) if self.in_turn else settled


def draw(
    renderers: Iterable[Renderer],
    known: SurveyedVolume,
    motion: Motion,
    step: Step,
    output: Path,
    rate: int,
    done: Callable[[int], None],
) -> tuple[int, int]:
    """Draw and write every frame; gives their width and height in pixels. `known` is the first volume."""
    with interrupts_held():  # imported when every server works
        from volsplat.client.figure.frame_figure import FrameFigure
        from volsplat.client.movie.movie import write_movie
    scenes = motion.scenes_of(known)
    about = FrameFigure(motion.figure or BARE, scenes, known, motion.in_turn)
    figure = about if motion.figure is not None else None
    write_movie(renderers, scenes, output, rate, done, lambda: False, step, figure)
    return about.extent


def check_output(output: Path, figure: Figure | None) -> None:
    """Raises BadInput for a movie that could not be written, or not with this figure."""
    if figure is not None and figure.transparent:
        check_clear(output)
    check_movie_writable(output)
    if figure is not None:
        check_words(figure, output)
