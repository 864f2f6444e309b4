"""`volsplat bench page`: how soon the page follows the hand, in a real browser."""

from __future__ import annotations

import math
import os
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

import click

from volsplat.bench.chromium_tab import chromium_tab
from volsplat.bench.page_drag import Drag, Start, dragged, show_in, started
from volsplat.bench.slow_link import slow_link
from volsplat.bench.subject import Subject, volume_file
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.record import figure, record
from volsplat.bench.tables.text_table import TextTable, significant
from volsplat.client.command.help_page import helped
from volsplat.client.command.side_console import SideConsole
from volsplat.program.extras import need
from volsplat.protocol.text.errors import BadInput, VolsplatError

WARM_UP_MOVES = 180
SHORT_MOVES, MORE_ENDS = 60, 4  # drags at whose end it is seen how like a moving picture is
IMAGE = 512
GOALS = "Goals on loopback: median 50 ms, 95 % 100 ms, 30 images a second, likeness 0.9, nothing stale."
_BROWSER = """#!/bin/sh
cat "${{1#file://}}" > {opened}.part && mv {opened}.part {opened}
"""
_LOOK_SECONDS = 0.005  # between looks at whether the browser was opened
_ADDRESS = re.compile(r"http://[^\"\s]+token=[\w-]+")


@helped("volsplat bench page head.nrrd", "volsplat bench page head.nrrd --link 20,40")
@click.argument("volume", required=False)
@click.option("--phantom", metavar="NAME:SIZE", help="In place of VOLUME: shells:256 is 256 x 256 x 256 voxels.")
@click.option("--workers", type=click.IntRange(min=1), default=2, help="Map/shade servers (2).")
@click.option("--moves", type=click.IntRange(min=10), default=300, help="Moves of the pointer (300).")
@click.option("--link", metavar="MBIT,MS", help="Through a line of so many Mbit/s and ms a round trip: 20,40.")
@output_options()
def page(workers: int, moves: int, link: str | None, **settings: Any) -> None:
    """Drag VOLUME about in headless Chromium, and time it from the pointer's event to the canvas's change."""
    outputs = Outputs.of(settings)
    need("psutil", "this benchmark", "bench")
    need("nicegui", "the page", "ui")
    line = _link(link) if link else None
    subject = Subject.of(settings)
    with SideConsole().status("starting") as status, volume_file(subject, status.update) as path:
        start, drag, likenesses = _measured(path, workers, moves, line, status.update)
    through = f", through {link.replace(',', ' Mbit/s, ')} ms" if link else ""
    title = f"{workers} map/shade servers, {IMAGE} x {IMAGE} pixels, {moves} moves{through}"
    report(start, drag, likenesses, title, outputs)


def _measured(
    path: str, workers: int, moves: int, line: tuple[float, float] | None, tell: Callable[[str], None]
) -> tuple[Start, Drag, list[float]]:
    """The start, the drag that is timed, and the likeness at the end of it and of some more."""
    with chromium_tab() as tab, _viewed(path, workers) as (address, began), _slowed(address, line) as reached:
        start = started(tab, reached, began)
        show_in(tab, IMAGE)
        tell("dragging, to warm up")
        dragged(tab, WARM_UP_MOVES)
        tell(f"dragging, {moves} moves")
        drag = dragged(tab, moves)
        more = [dragged(tab, SHORT_MOVES) for _ in range(MORE_ENDS)]
    return start, drag, [drag.likeness, *(short.likeness for short in more)]


def report(start: Start, drag: Drag, likenesses: Sequence[float], title: str, outputs: Outputs) -> None:
    """The table, and the files that are wanted."""
    late = sorted(drag.latencies())
    p95 = late[math.ceil(0.95 * len(late)) - 1]
    table = TextTable(f"The page follows the hand: {title}", ("", "median", "95 %", "greatest"), GOALS)
    table.add("event to canvas, ms", *(significant(value * 1e3) for value in (statistics.median(late), p95, late[-1])))
    facts = {
        "start": f"first picture after {significant(start.seen)} s, the first that can be turned after "
        f"{significant(start.streamed)} s",
        "images a second": significant(drag.images_per_second()),
        "drawn as": ", ".join(f"{way} {share:.0%}" for way, share in drag.drawn_as().items()),
        "likeness": f"{statistics.mean(likenesses):.3f} (SSIM of the last moving picture to the finished one, mean of "
        f"{len(likenesses)} drags, {min(likenesses):.3f} to {max(likenesses):.3f})",
        "stale images": str(drag.stale()),
        "lag grows by": f"{drag.growth() * 1e3:.0f} ms from the first third to the last",
    }
    figures = [
        figure("event to canvas", "s", late),
        figure("event to canvas: 95 %", "s", [p95]),
        figure("likeness", "SSIM", likenesses),
        figure("images a second", "1/s", [drag.images_per_second()]),
        figure("start: first picture", "s", [start.seen]),
        figure("start: first that can be turned", "s", [start.streamed]),
    ]
    outputs.deliver(record("page", facts, figures), [table])


@contextmanager
def _viewed(path: str, workers: int) -> Iterator[tuple[str, float]]:
    """The address that `volsplat view` opens the browser at, and when the command began, by time.time()."""
    command = [str(Path(sys.executable).with_name("volsplat")), "view", str(path), "--workers", str(workers)]
    with TemporaryDirectory() as folder:
        browser, opened = Path(folder, "browser"), Path(folder, "opened")
        browser.write_text(_BROWSER.format(opened=quote(str(opened))), "utf-8")
        browser.chmod(0o700)
        began = time.time()
        with subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, env=os.environ | {"BROWSER": f"{quote(str(browser))} %s"}
        ) as process:
            assert process.stderr is not None
            try:
                yield _address(process, opened), began
            finally:
                process.terminate()
                process.stderr.read()


def _address(process: subprocess.Popen[str], opened: Path) -> str:
    """Where the page that the browser opens leads to."""
    assert process.stderr is not None
    while not opened.exists():
        if process.poll() is not None:
            raise VolsplatError(f"`volsplat view` ended: {process.stderr.read().strip()}")
        time.sleep(_LOOK_SECONDS)
    found = _ADDRESS.search(opened.read_text("utf-8"))
    assert found is not None, "the browser is led to the page"
    return found[0]


@contextmanager
def _slowed(address: str, line: tuple[float, float] | None) -> Iterator[str]:
    port = urlsplit(address).port
    assert port is not None
    with nullcontext(port) if line is None else slow_link(port, bits_per_second=line[0], round_trip=line[1]) as through:
        yield address.replace(f":{port}/", f":{through}/")


def _link(text: str) -> tuple[float, float]:
    """Bits a second and seconds a round trip. Raises BadInput."""
    try:
        megabits, milliseconds = (float(part) for part in text.split(","))
    except ValueError:
        megabits = milliseconds = math.nan
    if not (megabits > 0 and milliseconds >= 0):
        raise BadInput(f"--link {text}: give MBIT,MS, as in 20,40 for 20 Mbit/s and 40 ms a round trip")
    return megabits * 1e6, milliseconds / 1e3
