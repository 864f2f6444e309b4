"""The kernels of the map/shade server or of the splat server on each instruction set that this CPU has."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Kernels(Protocol):
    """A module of kernels that are compiled once for each CPU path."""

    def cpu_path(self) -> str: ...
    def set_cpu_path(self, name: str) -> None: ...


@contextmanager
def kernels_on(kernels: Kernels, path: str) -> Iterator[None]:
    """Use one CPU path for a while."""
    before = kernels.cpu_path()
    kernels.set_cpu_path(path)
    try:
        yield
    finally:
        kernels.set_cpu_path(before)
