"""What a coarser voxel has of the gradients of the voxels that it stands for: their mean strength, the direction of
their sum, and how far they agree.

A gradient of its own, taken between means, would be weaker than those that it stands for wherever a surface is thinner
than the coarser voxel, and smoother than they are where they differ: pictures would lose surfaces, and light would fall
more evenly on what is left.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.packet_store import Packets
from volsplat.mapshade_server.prepare.halving import ALL_AXES, halved_shape, halved_sheets, sums
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.index_rules import (
    AGREEMENTS,
    DIRECTION_CODES,
    ROUGH_DIRECTIONS,
    ROUGH_NO_GRADIENT,
    ROUGH_SIDE,
    DirectionCode,
)
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT

SHEETS_AT_A_TIME = 4  # for each voxel of these some 100 bytes are held
STRENGTH_BITS = np.uint32(0xFF00)
DIRECTION_BITS = np.uint32((DIRECTION_CODES - 1) << DIRECTION_SHIFT)
LIMITS = [(one + next_one) / 2 for one, next_one in zip(AGREEMENTS, AGREEMENTS[1:], strict=False)]

Reals = NDArray[np.float64]


def halved_gradients(packets: Packets, code: DirectionCode, factors: Index = ALL_AXES) -> Packets:
    """Strengths and directions, in the bits of a packet, of `factors` voxels each (k, j, i), 1 or 2 along i, j, k.

    `packets` must begin at even indices of the volume, and end so or where the volume ends.
    """
    halves = np.empty(halved_shape(packets.shape, factors), np.uint32)
    for k in range(0, len(packets), SHEETS_AT_A_TIME):
        there = halved_sheets(k, factors, SHEETS_AT_A_TIME)
        halves[there] = _halved(packets[k : k + SHEETS_AT_A_TIME], code, factors)
    return halves


def with_gradients(packets: Packets, gradients: Packets, has_strength: bool) -> Packets:
    """Packets of a coarser level with these gradients in place of their own; there is no data where there was none."""
    taken = DIRECTION_BITS | STRENGTH_BITS if has_strength else DIRECTION_BITS
    replaced: Packets = np.where(packets >> NO_DATA_BIT == 0, packets & ~taken | gradients & taken, packets)
    return replaced


def _halved(packets: Packets, code: DirectionCode, factors: Index) -> Packets:
    there = packets >> NO_DATA_BIT == 0
    strengths = np.where(there, (packets & STRENGTH_BITS) >> 8, 0).astype(np.int64)
    counts = np.maximum(sums(there.astype(np.int64), factors), 1)
    mean_strengths = (2 * sums(strengths, factors) + counts) // (2 * counts)

    # All alike: what is seen of a block need not be where its gradients are strong, and light falls on it all the same
    directed = _along(code)[(packets & DIRECTION_BITS) >> DIRECTION_SHIFT]
    has_direction = there & directed.any(axis=-1)
    directions = has_direction.astype(np.int64)
    total = np.stack([sums(directed[..., axis] * directions, factors) for axis in range(3)], axis=-1)
    codes = _rough_codes(total, sums(directions, factors))
    gradients: Packets = (mean_strengths << 8 | codes << DIRECTION_SHIFT).astype(np.uint32)
    return gradients


def _rough_codes(total: Reals, directions: NDArray[np.int64]) -> NDArray[np.int64]:
    """The codes of these sums, (k, j, i, 3), of so many directions."""
    x, y, z = (total[..., axis] for axis in range(3))
    length = np.sqrt(x * x + y * y + z * z)
    agreement = length / np.maximum(directions, 1)
    roughness = sum((agreement < limit).astype(np.int64) for limit in LIMITS)

    size = np.abs(x) + np.abs(y) + np.abs(z)
    whole = np.where(size > 0.0, size, 1.0)
    x, y, z = x / whole, y / whole, z / whole
    right, up = np.where(x < 0, -1.0, 1.0), np.where(y < 0, -1.0, 1.0)
    across = np.where(z < 0, (1.0 - np.abs(y)) * right, x)
    along = np.where(z < 0, (1.0 - np.abs(x)) * up, y)
    middle = ROUGH_SIDE // 2
    u, v = (np.floor((place + 1.0) * middle + 0.5).astype(np.int64) for place in (across, along))
    codes = roughness * ROUGH_DIRECTIONS + v * ROUGH_SIDE + u
    return np.where((size > 0.0) & (directions > 0), codes, ROUGH_NO_GRADIENT)


@lru_cache(maxsize=3)
def _along(code: DirectionCode) -> Reals:
    """The mean of the unit vectors that each code stands for, (codes, 3); zeros for those without direction."""
    vectors: Reals = np.asarray(memoryview(_kernels.direction_vectors(code))).copy()
    if code == "rough":
        for n, agreement in enumerate(AGREEMENTS):
            vectors[n * ROUGH_DIRECTIONS : (n + 1) * ROUGH_DIRECTIONS] *= agreement
    return vectors
