"""What a coarser voxel has of the gradients of the voxels that it stands for: their mean strength, the direction of
their sum, and how far they agree; or the axis that they share, if they cancel.

A gradient of its own, taken between means, would be weaker than those that it stands for wherever a surface is thinner
than the coarser voxel, and smoother than they are where they differ: pictures would lose surfaces, and light would fall
more evenly on what is left.
"""

from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.packet_store import Packets
from volsplat.mapshade_server.prepare.halving import ALL_AXES, halved_shape, halved_sheets, sums
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.index_rules import (
    AGREEMENTS,
    DIRECTION_CODES,
    FIRST_TWO_FACED,
    LEAST_ALONG_AXIS,
    ROUGH_DIRECTIONS,
    ROUGH_NO_GRADIENT,
    ROUGH_SIDE,
    ROUGHNESS_COSINES,
    TWO_FACED_SIDE,
    DirectionCode,
)
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT

SHEETS_AT_A_TIME = 4  # for each voxel of these some 100 bytes are held
STRENGTH_BITS = np.uint32(0xFF00)
DIRECTION_BITS = np.uint32((DIRECTION_CODES - 1) << DIRECTION_SHIFT)
NO_DIRECTION = DIRECTION_CODES  # of voxels without data, beside the codes
MATRIX = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # of the six moments
ONE_SIDE = np.sqrt([1.0, 2.0, 3.0])  # of the two that an axis has: none of whole numbers lies across this
LIMITS = [(one + next_one) / 2 for one, next_one in zip(AGREEMENTS, AGREEMENTS[1:], strict=False)]

Reals = NDArray[np.float64]
Codes = NDArray[np.int64]


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
    finer = np.where(there, (packets & DIRECTION_BITS) >> DIRECTION_SHIFT, NO_DIRECTION)
    directions = sums(_has_direction(code)[finer].astype(np.int64), factors)
    total = np.stack([sums(along[finer], factors) for along in _along(code)], axis=-1)
    agreement = np.linalg.norm(total, axis=-1) / np.maximum(directions, 1)
    codes = _rough_codes(total, agreement)
    cancelling = (directions > 0) & (agreement < LIMITS[-1])
    moments = _moments(finer, code, factors, cancelling) / directions[cancelling]
    codes[cancelling] = _with_two_faced(codes[cancelling], moments)
    gradients: Packets = (mean_strengths << 8 | codes << DIRECTION_SHIFT).astype(np.uint32)
    return gradients


def _rough_codes(total: Reals, agreement: Reals) -> Codes:
    """The codes of these sums, (k, j, i, 3)."""
    roughness = sum((agreement < limit).astype(np.int64) for limit in LIMITS)
    codes: Codes = roughness * ROUGH_DIRECTIONS + _octahedral_places(total, ROUGH_SIDE)
    return np.where(total.any(axis=-1), codes, ROUGH_NO_GRADIENT)


def _with_two_faced(codes: Codes, moments: Reals) -> Codes:
    """These codes, (n,), but where directions of such moments, (6, n), lie along one axis its own."""
    x, y, z, yz, zx, xy = moments
    # The sum of the eigenvalues' squares, to find few of them: their own sum is 1
    likely = x * x + y * y + z * z + 2.0 * (yz * yz + zx * zx + xy * xy) > LEAST_ALONG_AXIS**2
    shares, axes = np.linalg.eigh(np.moveaxis(moments[MATRIX][..., likely], -1, 0))
    axis = axes[..., -1]
    places = _octahedral_places(np.where(axis @ ONE_SIDE < 0.0, -axis.T, axis.T).T, TWO_FACED_SIDE)
    codes = codes.copy()
    codes[likely] = np.where(shares[..., -1] > LEAST_ALONG_AXIS, FIRST_TWO_FACED + places, codes[likely])
    return codes


def _moments(finer: Codes, code: DirectionCode, factors: Index, chosen: NDArray[np.bool_]) -> Reals:
    """The sums of what directions are times themselves, of those that each chosen voxel is made of: (6, n)."""
    of_codes = _times_itself(code)
    beyond = [(0, -size % factor) for size, factor in zip(finer.shape, reversed(factors), strict=True)]
    even = np.pad(finer, beyond, constant_values=NO_DIRECTION)
    moments = np.zeros((len(of_codes), np.count_nonzero(chosen)))
    for corner in product(*map(range, reversed(factors))):
        there = tuple(slice(at, None, factor) for at, factor in zip(corner, reversed(factors), strict=True))
        moments += of_codes[:, even[there][chosen]]
    return moments


def _octahedral_places(vectors: Reals, side: int) -> Codes:
    """Of (..., 3), on an octahedron unfolded to a square; anywhere for one of no length."""
    x, y, z = (vectors[..., axis] for axis in range(3))
    size = np.abs(x) + np.abs(y) + np.abs(z)
    whole = np.where(size > 0.0, size, 1.0)
    x, y, z = x / whole, y / whole, z / whole
    right, up = np.where(x < 0, -1.0, 1.0), np.where(y < 0, -1.0, 1.0)
    across = np.where(z < 0, (1.0 - np.abs(y)) * right, x)
    along = np.where(z < 0, (1.0 - np.abs(x)) * up, y)
    middle = side // 2
    u, v = (np.floor((place + 1.0) * middle + 0.5).astype(np.int64) for place in (across, along))
    places: Codes = v * side + u
    return places


@lru_cache(maxsize=3)
def _along(code: DirectionCode) -> Reals:
    """The mean of the unit vectors that each code stands for, and 0 for NO_DIRECTION: (3, codes)."""
    vectors = _unit_vectors(code).copy()
    if code == "rough":
        for n, agreement in enumerate(AGREEMENTS):
            vectors[:, n * ROUGH_DIRECTIONS : (n + 1) * ROUGH_DIRECTIONS] *= agreement
        vectors[:, FIRST_TWO_FACED:] = 0.0
    return vectors


@lru_cache(maxsize=3)
def _times_itself(code: DirectionCode) -> Reals:
    """The mean of xx, yy, zz, yz, zx and xy of the unit vectors that each code stands for: (6, codes)."""
    x, y, z = _unit_vectors(code)
    moments: Reals = np.stack([x * x, y * y, z * z, y * z, z * x, x * y])
    if code == "rough":
        for n, cosines in enumerate(ROUGHNESS_COSINES):
            along = float(np.square(cosines).mean())
            of_roughness = moments[:, n * ROUGH_DIRECTIONS : (n + 1) * ROUGH_DIRECTIONS]
            of_roughness *= (3.0 * along - 1.0) / 2.0
            of_roughness[:3] += (1.0 - along) / 2.0
    return moments


@lru_cache(maxsize=3)
def _has_direction(code: DirectionCode) -> NDArray[np.bool_]:
    return np.asarray(_unit_vectors(code).any(axis=0))


@lru_cache(maxsize=3)
def _unit_vectors(code: DirectionCode) -> Reals:
    """(3, codes); zeros for codes without direction, and for NO_DIRECTION."""
    vectors = np.asarray(memoryview(_kernels.direction_vectors(code))).T
    return np.pad(vectors, [(0, 0), (0, 1)])
