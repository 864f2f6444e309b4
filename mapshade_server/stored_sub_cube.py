"""A sub-cube whose packets were made before, read from a packet store."""

from collections.abc import Callable

import numpy as np

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.packet_store import PacketStore
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.description.volume import Box


def stored_sub_cube(
    store: PacketStore, level: int, box: Box, given_up: Callable[[], bool] = lambda: False
) -> SubCube | None:
    """A box of a level; None if it was `given_up` while it was read.

    No more is held meanwhile than that and one sheet of bricks. Raises BadInput for damage.
    """
    _kernels.give_freed_memory_back()  # bricks are unpacked by many threads
    packets = np.asarray(memoryview(_kernels.empty_packets(box.size)))
    (i0, j0, k0), (i1, j1, k1) = box
    start = k0
    while start < k1:
        if given_up():
            return None
        end = min((start // store.brick_size + 1) * store.brick_size, k1)
        packets[start - k0 : end - k0] = store.read(level, Box((i0, j0, start), (i1, j1, end)))
        start = end
    return SubCube.of_packets(store.levels[level].geometry, box, packets)
