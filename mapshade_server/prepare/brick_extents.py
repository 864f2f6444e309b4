"""The least and greatest bytes of each brick's voxels, and whether it is stored, for leaving out what is not seen."""

import numpy as np

from volsplat.mapshade_server.held.block_densities import Bytes, by_block, extremes
from volsplat.mapshade_server.held.packet_store import BRICK_FIELDS, STORED, Packets
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT

DENSITY, STRENGTH, TOP = 0, 1, 3  # bytes of a packet, little-endian
TOP_NO_DATA = 1 << (NO_DATA_BIT - 24)


def brick_extents(packets: Packets, brick: int, background: int) -> Bytes:
    """uint8 (bk, bj, bi, 5) of packets (k, j, i) that begin with a brick; see packet_store.

    A brick without data has its least > greatest. One of nothing but the packet `background` is not stored.
    """
    nk, nj, ni = (-(-n // brick) for n in packets.shape)
    extents = np.empty((nk, nj, ni, BRICK_FIELDS), np.uint8)
    for n in range(nk):
        sheets = packets[n * brick : (n + 1) * brick].astype("<u4", copy=False)
        fields = sheets.view(np.uint8).reshape(*sheets.shape, 4)
        no_data = fields[..., TOP] & TOP_NO_DATA
        hidden = np.where(no_data, np.uint8(255), np.uint8(0)) if no_data.any() else None
        for at, field in ((0, DENSITY), (2, STRENGTH)):
            values = np.ascontiguousarray(fields[..., field])
            extents[n, ..., at], extents[n, ..., at + 1] = extremes(values, hidden, brick)
        extents[n, ..., STORED] = by_block(np.logical_or, sheets != background, brick)
    return extents
