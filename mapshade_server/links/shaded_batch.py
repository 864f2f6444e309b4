"""Shaded packets as a walker hands them over and a link sends them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ShadedPart:
    """Shaded packets for one region in traversal order, with the directory of their row runs; see packet_layout."""

    runs: memoryview  # bytes, 24 for each run
    packets: memoryview  # bytes, 8 for each packet
    run_count: int
    packet_count: int


@dataclass(frozen=True)
class ShadedBatch:
    """What a walker delivers at once."""

    parts: list[ShadedPart]  # for each region
    reached: tuple[int, int]  # (sheet, row): all that the walker has before it in traversal order has been delivered
    last: bool
    voxels_visited: int  # samples of the step within the bounds, those left out as hidden or outside the image included

    @property
    def packet_count(self) -> int:
        return sum(part.packet_count for part in self.parts)
