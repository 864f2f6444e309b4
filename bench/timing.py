"""Contenders measured in turns within one run, so that a busy machine slows all of them alike."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

Name = TypeVar("Name")
Round = TypeVar("Round")


def interleaved(
    contenders: Mapping[Name, Callable[[Round], float]],
    rounds: Iterable[Round],
    after_round: Callable[[Round], None],
) -> dict[Name, list[float]]:
    """What each contender measured in each round. Each round starts with another one, so that none is always first."""
    samples: dict[Name, list[float]] = {name: [] for name in contenders}
    for n, this in enumerate(rounds):
        for name in rotated(list(contenders), n):
            samples[name].append(contenders[name](this))
        after_round(this)
    return samples


def rotated(names: Sequence[Name], by: int) -> list[Name]:
    """The names in a circle, from another start."""
    start = by % len(names) if names else 0
    return [*names[start:], *names[:start]]


def thread_seconds(work: Callable[[], object]) -> float:
    """Seconds of CPU time that this thread needed: what other programs take does not count."""
    began = time.thread_time()
    work()
    return time.thread_time() - began


def processor_seconds(work: Callable[[], object]) -> float:
    """Likewise of all threads of this process: of one thread what a person waits for on a quiet machine."""
    began = time.process_time()
    work()
    return time.process_time() - began


def wall_seconds(work: Callable[[], object]) -> float:
    """Seconds that a person waits."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def ratios(above: Sequence[float], below: Sequence[float]) -> list[float]:
    """Of samples taken in pairs."""
    return [a / b for a, b in zip(above, below, strict=True)]
