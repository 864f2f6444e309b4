"""`volsplat bench aborts`: how long an abort takes to reach every server while a large frame runs."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import click
import msgspec

from volsplat.bench.renderers import local_session
from volsplat.bench.subject import Subject, volume_file, volume_words
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import figure, record
from volsplat.bench.tables.text_table import TextTable, significant
from volsplat.bench.timing import wall_seconds
from volsplat.client.command.help_page import helped
from volsplat.client.command.side_console import SideConsole
from volsplat.client.session.asked_frames import FrameGivenUp
from volsplat.client.session.session import Session
from volsplat.protocol.description.scene import LARGEST_EXTENT, Image, Scene, View
from volsplat.protocol.text.errors import BadInput

GOAL_SECONDS = 0.050  # at the 95th percentile
MOST_LATE = 100  # aborts in a row that come after their frame
HIGH_ZOOM = 64.0  # pixels a voxel: a packet's footprint covers tens of thousands of pixels
VIEWS = {"the whole volume": View(), f"zoom {HIGH_ZOOM:g}": View(zoom=HIGH_ZOOM)}


@helped("volsplat bench aborts --aborts 50")
@click.option("--phantom", default="shells:256", metavar="NAME:SIZE", help="What is drawn (shells:256).")
@click.option("--aborts", "count", type=click.IntRange(min=1), default=200, help="In each view (200).")
@click.option("--workers", type=click.IntRange(min=1), default=2, help="Map/shade servers (2).")
@click.option("--splat-servers", type=click.IntRange(min=1), default=1, help="Splat servers (1).")
@click.option(
    "--image", type=click.IntRange(16, LARGEST_EXTENT), default=1024, help="Side of the square image, pixels (1024)."
)
@output_options()
def aborts(count: int, workers: int, splat_servers: int, image: int, **settings: Any) -> None:
    """Abort frames at random moments, seen from random sides, and time it until the last server has acknowledged.

    Once for the whole volume in view, once for a zoom at which a packet's footprint covers tens of thousands of pixels.
    """
    outputs = Outputs.of(settings)
    subject = Subject.of(settings)
    table = TextTable(
        f"Aborts, {workers} map/shade and {splat_servers} splat servers, {image} x {image} pixels: "
        "milliseconds until all have acknowledged",
        ("view", "a frame", "median", "95 %", "greatest"),
        f"{count} aborts at random moments of a frame. Goal at 95 %: {GOAL_SECONDS * 1e3:.0f} ms.",
    )
    figures = []
    chance = random.Random(1)
    console = SideConsole()
    with console.status("starting") as status, volume_file(subject, status.update) as path:
        with local_session(path, workers, status.update, splat_servers=splat_servers) as session:
            known = session.volume
            status.stop()
            for title, view in VIEWS.items():
                shown = subject.scene_of(known)
                scene = msgspec.structs.replace(shown, image=Image(width=image, height=image), view=view)
                whole = min(wall_seconds(partial(session.render, scene)) for _ in range(3))
                with shown_progress(title, count) as step:
                    seconds = sorted(abort_times(session, scene, count, whole, chance, step))
                late = seconds[math.ceil(0.95 * len(seconds)) - 1]
                median = figure(f"{title}: abort", "s", seconds)
                figures += [median, figure(f"{title}: 95 % of the aborts", "s", [late])]
                cells = (whole, median.median, late, seconds[-1])
                table.add(title, *(significant(value * 1e3) for value in cells))
    outputs.deliver(record("aborts", {"volume": volume_words(known)}, figures), [table])


def abort_times(
    session: Session, scene: Scene, count: int, whole: float, chance: random.Random, on_abort: Callable[[], None]
) -> list[float]:
    """Seconds of so many aborts that came before their frame, of about `whole` seconds, was finished.

    Raises what ends the session, and BadInput where frames are finished sooner than they can be aborted.
    """
    seconds: list[float] = []
    late = 0
    while len(seconds) < count:
        turned = msgspec.structs.replace(scene.view, rotation=tuple(chance.gauss(0, 1) for _ in range(4)))
        took = abort_seconds(session, msgspec.structs.replace(scene, view=turned), chance.uniform(0.05, 0.6) * whole)
        late = late + 1 if took is None else 0
        if took is not None:
            seconds.append(took)
            on_abort()
        elif late == MOST_LATE:
            raise BadInput(
                f"{late} frames in a row were finished before they could be aborted; draw more: a larger --image or "
                "--phantom"
            )
    assert session.render(scene)[..., 3].max() > 0, "after all aborts, a frame must still be drawn"
    return seconds


def abort_seconds(session: Session, scene: Scene, delay: float) -> float | None:
    """Seconds until an abort, asked for `delay` seconds into the frame, is acknowledged; None if it came too late.

    Raises what the frame ended with otherwise.
    """
    with ThreadPoolExecutor(1) as thread:
        drawing = thread.submit(session.render, scene)
        time.sleep(delay)
        asked = time.perf_counter()
        session.abort()
        try:
            drawing.result()
        except FrameGivenUp:
            return time.perf_counter() - asked
    return None
