"""Shaded packets for one region, as a walker hands them over and a link sends them."""

from dataclasses import dataclass

from volsplat.mapshade_server import _kernels


@dataclass(frozen=True)
class ShadedPart:
    """Shaded packets for one region in traversal order, with the directory of their row runs; see packet_layout."""

    runs: memoryview  # bytes, 24 for each run
    packets: memoryview  # bytes, 8 for each packet
    run_count: int
    packet_count: int


def parts_of(batch: _kernels.Batch) -> list[ShadedPart]:
    """For each region."""
    return [ShadedPart(*part) for part in batch.parts]
