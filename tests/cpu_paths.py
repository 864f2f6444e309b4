"""Runs the map/shade kernels on each instruction set that this CPU has: every kernel test goes over all of them."""

from collections.abc import Iterator
from contextlib import contextmanager

from volsplat.mapshade_server import _kernels


@contextmanager
def kernels_on(path: str) -> Iterator[None]:
    """Use one CPU path for a while."""
    before = _kernels.cpu_path()
    _kernels.set_cpu_path(path)
    try:
        yield
    finally:
        _kernels.set_cpu_path(before)
