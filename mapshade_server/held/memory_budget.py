"""Whether a map/shade server has room for its part of a volume: said before it reads, or the system might kill it."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from volsplat.mapshade_server.held.memory_promises import MemoryPromises
from volsplat.program.machine_limits import available_memory
from volsplat.protocol.description.volume import HALO, SCALAR_BYTES, Box, VolumeDescription
from volsplat.protocol.rules.levels import LISTS_PER_PACKET
from volsplat.protocol.rules.packet_layout import VOXEL_PACKET_BYTES
from volsplat.protocol.text.byte_sizes import bytes_text
from volsplat.protocol.text.errors import NoRoom

LIST_BYTES = VOXEL_PACKET_BYTES * LISTS_PER_PACKET  # that a walk keeps of a voxel
NEEDED_BYTES, NEEDED_ROW_BYTES = 4, 16  # that one of step G keeps beside: see kernels/slabs/needed_rows.h


class Use(NamedTuple):
    """What memory is for, and what to do if there is none."""

    what: str
    cure: str


SUB_CUBE = Use("the sub-cube", "use more machines, or prepare the volume (volsplat prepare)")
NEEDED = Use("the voxels that step G keeps of the sub-cube", "use more machines, or draw step F")


@dataclass(frozen=True)
class MemoryBudget:
    """What a server may hold of volumes: `limit` bytes, and no more than the machine has left.

    `promises` are those of the servers of this machine; without any this process is the only one.
    """

    limit: int | None = None
    promises: MemoryPromises | None = None

    def take(self, needed: int, held: int, let_go: int, use: Use = SUB_CUBE) -> None:
        """Before so much is taken, once `let_go` of the bytes that are `held` are free: have others leave it alone.

        Until it has been taken, and `taken` is called. Raises NoRoom unless there is room.
        """
        if self.limit is not None and needed > self.limit - (held - let_go):
            raise _no_room(use, needed, f"--memory leaves {bytes_text(self.limit - (held - let_go))}")

        def has_room(promised: int) -> None:
            if needed > (left := available_memory() + let_go - promised):
                others = ", besides what its other servers are about to take" if promised else ""
                raise _no_room(use, needed, f"its machine has {bytes_text(left)} left{others}")

        if self.promises is None:
            has_room(0)
        else:
            self.promises.claim(needed - let_go, has_room)

    def taken(self) -> None:
        """All of it, or as much as ever will be."""
        if self.promises is not None:
            self.promises.settle()


def bytes_to_read(description: VolumeDescription, boxes: Iterable[Box]) -> int:
    """At the most at once, while boxes are read and packed, and then drawn."""
    return sum(
        max(_source_bytes(description, box), int(LIST_BYTES * box.voxels)) + VOXEL_PACKET_BYTES * box.voxels
        for box in boxes
    )


def bytes_to_change(description: VolumeDescription, boxes: Iterable[Box], held: Iterable[Box]) -> int:
    """Likewise, where what is held is copied, box by box, and the rest read."""
    kept = list(held)
    new = [box for box in boxes if box not in kept]
    rest = [part for box in new for part in box.without(*kept)]
    reading = max((_source_bytes(description, part) + VOXEL_PACKET_BYTES * part.voxels for part in rest), default=0)
    lists = int(LIST_BYTES * sum(box.voxels for box in new))
    return VOXEL_PACKET_BYTES * sum(box.voxels for box in new) + max(reading, lists)


def bytes_to_walk_slabs(box: Box, needed: int) -> int:
    """Likewise, beside what `bytes_to_read` counts, if so many voxels are needed, in rows along whichever axis."""
    return NEEDED_BYTES * needed + NEEDED_ROW_BYTES * box.voxels // min(box.size)


def bytes_to_lend(description: VolumeDescription) -> int:
    """For a volume that only comes whole."""
    return _source_bytes(description, description.geometry.box)


def _source_bytes(description: VolumeDescription, box: Box) -> int:
    second = 0 if description.second_scalar is None else box.voxels
    voxels = box.grown(HALO, description.geometry.dims).voxels + second
    return SCALAR_BYTES[description.scalar_type] * voxels


def _no_room(use: Use, needed: int, room: str) -> NoRoom:
    return NoRoom(f"no memory for {use.what}: it needs {bytes_text(needed)}, but {room}; {use.cure}")
