"""Shaded packets as a walker hands them over and a link sends them."""

from dataclasses import dataclass
from functools import cached_property

from volsplat.mapshade_server import _kernels


@dataclass(frozen=True)
class ShadedPart:
    """Shaded packets for one region in traversal order, with the directory of their row runs; see packet_layout."""

    runs: memoryview  # bytes, 24 for each run
    packets: memoryview  # bytes, 8 for each packet
    run_count: int
    packet_count: int


class ShadedBatch:
    """What a walker delivers at once."""

    def __init__(self, kernel: _kernels.Batch) -> None:
        self.kernel = kernel

    @cached_property
    def parts(self) -> list[ShadedPart]:
        """For each region."""
        return [ShadedPart(*part) for part in self.kernel.parts]

    @property
    def reached(self) -> tuple[int, int]:
        """(sheet, row): all that the walker has before it in traversal order has been delivered."""
        return self.kernel.reached

    @property
    def last(self) -> bool:
        return self.kernel.last

    @property
    def voxels_visited(self) -> int:
        """Samples of the step within the bounds, those left out as hidden or outside the image included."""
        return self.kernel.voxels_visited

    @property
    def packet_count(self) -> int:
        return self.kernel.packet_count
