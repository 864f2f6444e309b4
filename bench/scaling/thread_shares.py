"""How a frame's work is shared among the threads of this process, by the processor time that each of them took.

It needs no more cores than one: what one thread does alone is counted, however many run at once.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure
from volsplat.bench.tables.text_table import TextTable, give_or_take, significant
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

THREADS_OF_PROCESS = Path("/proc/self/task")
CLOCK_OF_THREAD = 6  # of clockid_t: scheduled time of one thread, below the complement of its number


@dataclass(frozen=True)
class FrameShares:
    """Of one frame."""

    seconds: float  # that passed
    by_thread: tuple[float, ...]  # processor time of those that took any, the busiest first

    @property
    def all_threads(self) -> float:
        return sum(self.by_thread)

    def serial_part(self, threads: int) -> float:
        """What the busiest thread took beyond an even share, as part of all processor time."""
        return self.by_thread[0] / self.all_threads - 1 / threads


@dataclass(frozen=True)
class SharesOfThreads:
    """The frames of one number of threads."""

    threads: int
    frames: Sequence[FrameShares]

    @property
    def name(self) -> str:
        return f"{self.threads} thread{'s' if self.threads > 1 else ''}"

    @property
    def seconds(self) -> Figure:
        return figure(f"{self.name}: frame", "s", [frame.seconds for frame in self.frames])

    @property
    def processor_seconds(self) -> Figure:
        return figure(f"{self.name}: processor time", "s", [frame.all_threads for frame in self.frames])

    @property
    def serial_part(self) -> Figure:
        return figure(f"{self.name}: serial part", "1", [frame.serial_part(self.threads) for frame in self.frames])


def check_threads_are_seen() -> None:
    """Raises BadInput where the system does not show what each thread took."""
    if not THREADS_OF_PROCESS.is_dir():
        raise BadInput(f"--threads needs {THREADS_OF_PROCESS}, which only Linux has; leave it out")


def shares_of_threads(path: str, numbers: Sequence[int], scenes: Sequence[Scene]) -> list[SharesOfThreads]:
    """Every scene by the single process with each number of threads; the first is drawn twice before."""
    found = []
    with shown_progress("frames by threads", len(numbers) * len(scenes)) as step:
        for threads in numbers:
            frames = []
            with SingleProcess(path, threads=threads) as renderer:
                for scene in [scenes[0], scenes[0], *scenes]:
                    frames.append(_frame(renderer, scene))
                    step()
            found.append(SharesOfThreads(threads, frames[2:]))
    return found


def _frame(renderer: SingleProcess, scene: Scene) -> FrameShares:
    before, began = thread_seconds(), time.perf_counter()
    renderer.finish(scene)
    seconds, after = time.perf_counter() - began, thread_seconds()
    took = (now - before.get(thread, 0.0) for thread, now in after.items())
    return FrameShares(seconds, tuple(sorted((one for one in took if one > 0), reverse=True)))


def thread_seconds() -> dict[int, float]:
    """The processor time of each thread of this process so far, by its number."""
    seconds = {}
    for thread in map(int, os.listdir(THREADS_OF_PROCESS)):
        try:
            seconds[thread] = time.clock_gettime(~thread << 3 | CLOCK_OF_THREAD)
        except OSError:
            continue  # it has ended meanwhile
    return seconds


def threads_table(taken: Sequence[SharesOfThreads], side: int) -> TextTable:
    """A column for each number of threads."""
    table = TextTable(
        f"Threads of a single process, {side} x {side} pixels",
        ("", *(one.name for one in taken)),
        "Serial part: what the busiest thread took beyond an even share, as part of the processor time of all. Bound: "
        "how many times as fast as its own processor time a frame can be on as many whole cores.",
    )
    table.add("milliseconds a frame", *(significant(one.seconds.median * 1e3) for one in taken))
    table.add("", *(give_or_take(one.seconds) for one in taken))
    least = taken[0].processor_seconds.median
    table.add("times as fast", *(significant(taken[0].seconds.median / one.seconds.median) for one in taken))
    table.add("processor time, ms", *(significant(one.processor_seconds.median * 1e3) for one in taken))
    table.add("over the first", *(significant(one.processor_seconds.median / least) for one in taken))
    table.add("serial part, %", *(significant(one.serial_part.median * 100) for one in taken))
    table.add("bound", *(significant(_bound(one)) for one in taken))
    return table


def _bound(taken: SharesOfThreads) -> float:
    return statistics.median(frame.all_threads / frame.by_thread[0] for frame in taken.frames)


def thread_figures(taken: Sequence[SharesOfThreads]) -> list[Figure]:
    return [figure for one in taken for figure in (one.seconds, one.processor_seconds, one.serial_part)]
