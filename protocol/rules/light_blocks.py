"""Blocks of a volume by which light is dimmed on its way through it, in frames of slabs.

Blocks divide the grid of the level that is drawn, at most MOST_LIGHT_BLOCKS on an axis. A voxel has the optical depth
of one reference spacing, -log(1 - opac modu), in whole numbers of 1 / SUM_UNIT, so that what servers add up for their
parts of a block does not depend on who adds it. A block has the mean over its voxels; those not drawn have none.

From a direction light comes to the middle of a block as in a buffer that is swept through the blocks (Zhang and Crawfis
2002), from slice to slice across the axis along which the direction goes farthest: as it arrives at the point of the
slice before that lies that way, between its four blocks, each dimmed by its depth. A block does not dim itself, nor is
anything dimmed outside of the grid. That makes shadows as soft as blocks are wide, and softer with distance.
"""

import math

import msgspec

from volsplat.protocol.description.block_extremes import block_dims, block_size
from volsplat.protocol.description.scene import Light
from volsplat.protocol.description.volume import LONGEST_AXIS, Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.rules.frame_plan import FramePlan

MOST_LIGHT_BLOCKS = 64  # on an axis
SUM_UNIT = 1 << 16  # of depths that are summed
DEPTH_UNIT = 1 << 12  # of mean depths
DEPTH_BYTES = 2
SUM_BYTES = 8
LEAST_THROUGH = 1 / 4096  # of a reference spacing: its depth is finite

_GOLDEN = (1 + math.sqrt(5)) / 2
# The corners of a dodecahedron: light from all sides.
SKY: tuple[Vector, ...] = (
    *((x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)),
    *((0.0, y / _GOLDEN, z * _GOLDEN) for y in (-1.0, 1.0) for z in (-1.0, 1.0)),
    *((x / _GOLDEN, y * _GOLDEN, 0.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)),
    *((x * _GOLDEN, 0.0, z / _GOLDEN) for x in (-1.0, 1.0) for z in (-1.0, 1.0)),
)


class LightBlocks(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What dims light on its way, and how much of that is seen."""

    size: Index  # voxels of a block along i, j, k
    dims: Index  # blocks
    depths: bytes  # of each block, uint16 little endian in 1 / DEPTH_UNIT, (k, j, i), i fastest
    shadows: float
    occlusion: float

    def __post_init__(self) -> None:
        if not all(1 <= count <= MOST_LIGHT_BLOCKS for count in self.dims):
            raise ValueError(f"light passes 1 to {MOST_LIGHT_BLOCKS} blocks on an axis, not {self.dims}")
        if not all(1 <= voxels <= LONGEST_AXIS for voxels in self.size):
            raise ValueError(f"a block that light passes has 1 to {LONGEST_AXIS} voxels on an axis, not {self.size}")
        if len(self.depths) != DEPTH_BYTES * math.prod(self.dims):
            raise ValueError(f"{self.dims} blocks have no {len(self.depths)} bytes of depths")
        Light(shadows=self.shadows, occlusion=self.occlusion)


class LightStep(msgspec.Struct, frozen=True):
    """To the next slice of blocks towards where light comes from."""

    step: Vector  # in blocks; 1 or -1 along one axis, no farther along others
    length: float  # reference spacings


def light_block_size(dims: Index) -> Index:
    """Voxels of a block of a level of so many voxels."""
    return block_size(dims, MOST_LIGHT_BLOCKS)


def light_block_dims(dims: Index) -> Index:
    """Blocks of a level of so many voxels."""
    return block_dims(dims, MOST_LIGHT_BLOCKS)


def box_drawn(plan: FramePlan) -> Box:
    """The voxels within the bounds of a frame of slabs."""
    assert plan.slabs is not None
    (i0, j0, k0), (i1, j1, k1) = (
        tuple(math.ceil(end) for end in corner) for corner in (plan.slabs.low, plan.slabs.high)
    )
    return Box((i0, j0, k0), (i1, j1, k1))


def to_blocks(geometry: Geometry, factors: Index, size: Index) -> Matrix:
    """From physical vectors to those in blocks."""
    rows = matrices.inverse(geometry.index_to_physical)
    i, j, k = (
        matrices.scaled(row, 1 / (factor * voxels)) for row, factor, voxels in zip(rows, factors, size, strict=True)
    )
    return (i, j, k)


def light_step(direction: Vector, geometry: Geometry, factors: Index, size: Index) -> LightStep:
    """Towards a direction along physical axes. Raises ValueError if float64 cannot compute with them."""
    unit = matrices.normalised(direction)
    blocks = matrices.applied(to_blocks(geometry, factors, size), unit)
    longest = max(map(abs, blocks))
    if not 0.0 < longest < math.inf:
        raise ValueError("the volume's place in space is beyond what light can be computed for in float64")
    length = 1 / longest
    return LightStep(matrices.scaled(blocks, length), length / geometry.reference_spacing)
