"""How a volume is divided: levels, shards, and the blocks that are worked on at a time."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import msgspec

from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.rules.levels import dims_at_level
from volsplat.protocol.rules.packet_layout import MOST_MIXTURE_ENTRIES, VOXEL_PACKET_BYTES
from volsplat.protocol.text.errors import BadInput

MIB = 1 << 20

# Measured peaks beyond the arrays that are counted: the interpreter with its libraries, and, in shards, what Zarr
# copies while it compresses one.
PROGRAM_BYTES = 150 * MIB
SHARDS_IN_WRITING = 3
MIXTURE_BYTES = 24  # of each entry while it is counted

# An axis whose steps are so many times those of another one waits for it, so that levels become cubic
WAITING = math.sqrt(2.0)
ROUNDING = 1e-6  # of spacings


class Layout(msgspec.Struct, frozen=True):
    """Voxels along each side of bricks and shards, even, and of the coarsest level in all; the tests take smaller ones.

    A core draws a level of at most `coarsest` voxels in some ten milliseconds, whatever its shape. Nothing would be won
    by further ones, which are less and less like the volume.
    """

    brick: int = 64
    shard: int = 256
    coarsest: int = 128**3

    def shard_size(self, dims: Index) -> Index:
        """Of a level of `dims`, as (i, j, k): no larger than its bricks need."""
        i, j, k = (min(self.shard, -(-n // self.brick) * self.brick) for n in dims)
        return (i, j, k)

    def levels(self, geometry: Geometry) -> list[Geometry]:
        """Of all levels, finest first, until the whole volume has at most `coarsest` voxels."""
        levels = [geometry]
        while levels[-1].box.voxels > self.coarsest:
            levels.append(halved_geometry(levels[-1]))
        return levels

    def blocks(self, dims: Index, shards_in_a_row: int) -> Iterator[Box]:
        """The blocks of a level in the order of the work."""
        si, sj, sk = self.shard_size(dims)
        yield from _tiles(dims, (si * shards_in_a_row, sj, sk))

    def shards(self, dims: Index, block: Box) -> Iterator[Box]:
        """The shards that a block of a level of `dims` is made of."""
        for tile in _tiles(block.size, self.shard_size(dims)):
            yield Box(_sum(block.low, tile.low), _sum(block.low, tile.high))


def _tiles(dims: Index, size: Index) -> Iterator[Box]:
    for k in range(0, dims[2], size[2]):
        for j in range(0, dims[1], size[1]):
            for i in range(0, dims[0], size[0]):
                low = (i, j, k)
                yield Box(low, _clipped(_sum(low, size), dims))


def _sum(a: Index, b: Index) -> Index:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _clipped(index: Index, dims: Index) -> Index:
    return (min(index[0], dims[0]), min(index[1], dims[1]), min(index[2], dims[2]))


def halved_axes(geometry: Geometry) -> Index:
    """How many voxels of a level make one of the next along i, j, k, 1 or 2: the finest axes are halved.

    Slices that are thicker than the voxels of a slice are wide stay as they are until these are as large.
    """
    steps = [step for step, n in zip(geometry.spacing, geometry.dims, strict=True) if n > 1]
    limit = WAITING * min(steps, default=0.0) * (1.0 - ROUNDING)
    i, j, k = (1 + (n > 1 and step < limit) for step, n in zip(geometry.spacing, geometry.dims, strict=True))
    return (i, j, k)


def halved_geometry(geometry: Geometry) -> Geometry:
    """That of the next level: its first voxel lies in the middle of those of which it is made."""
    factors = halved_axes(geometry)
    matrix: Matrix = tuple(  # type: ignore[assignment]
        tuple(entry * factor for entry, factor in zip(row, factors, strict=True)) for row in geometry.index_to_physical
    )
    i, j, k = (0.5 * (factor - 1) for factor in factors)
    shift = matrices.applied(geometry.index_to_physical, (i, j, k))
    return Geometry(dims_at_level(geometry.dims, factors), matrix, matrices.plus(geometry.origin, shift))


@dataclass(frozen=True)
class MemoryPlan:
    """What `memory` bytes allow: shards of a block, and blocks that are held at a time."""

    shards_in_a_row: int
    blocks: int


def memory_plan(
    layout: Layout, dims: Index, item_bytes: Sequence[int], memory: int, whole_rows: bool = False, of_mean: int = 8
) -> MemoryPlan:
    """The longest blocks of which two fit, for one is packed while the other is written; else one at a time.

    With `whole_rows`, of a file of which only those can be read, a single block that has them is better than two.
    If whole rows fit, one for each processor. Held of each voxel of a block: its scalars, of so many bytes each,
    its packet, and its part of each scalar of the next level, of which every voxel is the mean of `of_mean`; of each
    shard the mixture, which has at most as many entries as voxels. Raises BadInput for too little memory.
    """
    si, sj, sk = layout.shard_size(dims)
    voxels = si * sj * sk
    mean_bytes = -(-8 * len(item_bytes) // of_mean)  # at most 8 each
    mixture_bytes = min(voxels, MOST_MIXTURE_ENTRIES) * MIXTURE_BYTES
    block_bytes = voxels * (sum(item_bytes) + VOXEL_PACKET_BYTES + mean_bytes) + mixture_bytes
    fixed = PROGRAM_BYTES + SHARDS_IN_WRITING * voxels * VOXEL_PACKET_BYTES
    room = (memory - fixed) // block_bytes  # in shards
    if room < 1:
        raise BadInput(f"--memory: this volume needs at least {-(-(fixed + block_bytes) // MIB)}M")
    row = -(-dims[0] // si)
    shards = row if whole_rows and room >= row else min(max(room // 2, 1), row)
    return MemoryPlan(shards, min(room // shards, (usable_cores()) + 1))
