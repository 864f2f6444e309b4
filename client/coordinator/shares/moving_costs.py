"""What it costs to have sub-cubes change hands: seconds, and memory."""

from collections.abc import Mapping

from volsplat.protocol.description.volume import Box
from volsplat.protocol.rules.levels import LISTS_PER_PACKET
from volsplat.protocol.rules.packet_layout import VOXEL_PACKET_BYTES


class MovingCosts:
    """By server."""

    def __init__(self, memory: Mapping[int, int]) -> None:
        """`memory` is how many bytes each of them may hold."""
        self._memory = memory
        self._seconds: dict[int, float] = {}  # to read a packet, or its voxel and make it

    def read(self, server: int, seconds: float, voxels: int) -> None:
        """So long it took to have these voxels, or packets that were made before."""
        self._seconds[server] = seconds / voxels

    def packed(self, server: int, seconds: float, voxels: int) -> None:
        """And so long to make packets of them."""
        self._seconds[server] = self._seconds.get(server, 0.0) + seconds / voxels

    def seconds(self, old: Mapping[int, list[Box]], new: Mapping[int, Box], packets: float) -> float:
        """Until all hold the new boxes. `packets` are held for each voxel."""
        return max(self._seconds.get(n, 0.0) * packets * _voxels_to_read(old[n], box) for n, box in new.items())

    def most_voxels(self, server: int, held: int, packets: float) -> int:
        """That it has room for beside those that it holds, which it keeps until it has others."""
        return max(int((self._memory[server] / (VOXEL_PACKET_BYTES * packets) - held) / (1 + LISTS_PER_PACKET)), 1)


def _voxels_to_read(old: list[Box], new: Box) -> int:
    return new.voxels - sum(common.voxels for box in old if (common := new.common(box)) is not None)
