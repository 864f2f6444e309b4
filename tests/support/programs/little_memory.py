"""Runs short of memory, on Linux."""

import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import psutil


@contextmanager
def little_memory(more: int) -> Iterator[None]:
    """This process may map but so many more bytes meanwhile."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + more, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@contextmanager
def no_more_threads() -> Iterator[None]:
    """The system gives this process no further thread meanwhile: its stack would not fit, nor one kept for reuse."""
    before = threading.stack_size(1 << 30)
    try:
        with little_memory(256 << 20):
            yield
    finally:
        threading.stack_size(before)
