"""What is seen of columns of a level's voxels and of those that they stand for, in plain float64."""

import math
from itertools import product

import torch
from torch import Tensor

from reference.level_means import sides_of
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT

BEYOND = (1 << 32) - 1
CODES = 1 << 15
ACROSS = (0.2, 0.3, 0.3, 0.2)  # of what a bundle sees, the four finer voxels across it
STEPS, STEP = 4, 0.5  # of the light


def row(finer: Tensor, coarser: Tensor, voxel: tuple[int, int, int]) -> list[int]:
    """A voxel (i, j, k) of the level, and the eight that it stands for."""
    k, j, i = reversed(voxel)
    told, sides = [int(coarser[k, j, i])], sides_of(finer.shape, coarser.shape)
    for corner in product((0, 1), repeat=3):
        child = tuple(n * side + at for n, side, at in zip((k, j, i), sides, corner, strict=True))
        there = all(at < side for at, side in zip(corner, sides, strict=True)) and all(
            n < size for n, size in zip(child, finer.shape, strict=True)
        )
        told.append(int(finer[child]) if there else BEYOND)
    return told


def column(
    dims: tuple[int, int, int], direction: tuple[int, int, int], first: tuple[int, int, int], order: tuple[int, ...]
) -> list[tuple[int, ...]]:
    """The voxels (i, j, k) of the column that goes through this one, and takes its axes in this order from there."""
    found = []
    for turn in range(-max(dims), max(dims) + 1):
        voxel = [at + turn * along for at, along in zip(first, direction, strict=True)]
        for axis in order:
            if all(0 <= at < size for at, size in zip(voxel, dims, strict=True)):
                found.append(tuple(voxel))
            voxel[axis] += direction[axis]
    return found


class Seen:
    """Of the finer or the coarser voxels of a column or bundle."""

    def __init__(self, table: Tensor) -> None:
        self._table = table
        self.emitted = 0.0
        self.reflected = torch.zeros((CODES, STEPS), dtype=torch.float64)
        self.through = 1.0

    def layer(self, parts: list[tuple[int, float]]) -> None:
        """Packets that are seen as one, each so much of it."""
        parts = [(packet, part) for packet, part in parts if packet >> NO_DATA_BIT == 0]
        depths = [part * float(self._table[packet & 65535, 0]) for packet, part in parts]
        if sum(depths) == 0.0:
            return
        stopped = self.through * -math.expm1(-sum(depths))
        for (packet, _), depth in zip(parts, depths, strict=True):
            seen = stopped * depth / sum(depths)
            self.emitted += seen * float(self._table[packet & 65535, 1])
            self.reflected[packet >> DIRECTION_SHIFT & CODES - 1] += seen * self._table[packet & 65535, 2:]
        self.through -= stopped


def seen(
    column: Tensor,
    axis: int | None,
    from_high: bool,
    finer: Tensor,
    coarser: Tensor,
    sides: tuple[int, int, int] = (2, 2, 2),
    high_first: tuple[bool, bool] = (True, True),
) -> tuple[float, float, Tensor, Tensor]:
    """Emitted by the finer and the coarser voxels of one column, or along an axis of one bundle, whose rows come four
    to a layer; and reflected by direction code and step of the light.

    Tables have a layer's depth, what is emitted, and what is reflected of each step. A coarser voxel stands for so many
    finer ones along i, j, k; without an axis, of a diagonal, all these are one layer.
    """
    fine, coarse = Seen(finer), Seen(coarser)
    layers = column.reshape(-1, 1 if axis is None else 4, column.shape[1]).tolist()
    for rows in reversed(layers) if from_high else layers:
        if max(fine.through, coarse.through) <= 1 / 1024:
            break
        there = [sum(packet != BEYOND for packet in told[1:]) / math.prod(sides) for told in rows]
        if axis is None:
            coarse.layer([(rows[0][0], there[0])])
            fine.layer([(packet, 1 / math.prod(sides)) for packet in rows[0][1:]])
            continue
        signs = [-1 if high else 1 for high in high_first]
        for n in sorted(range(4), key=lambda n: (signs[1] * (n >> 1), signs[0] * (n & 1))):
            coarse.layer([(rows[n][0], there[n] / 4)])
        a, b = (aside for aside in range(3) if aside != axis)
        for side in (1, 0) if from_high else (0, 1):
            places = []
            for n, child in product(range(4), range(8)):
                if child >> axis & 1 == side:
                    at_a = (n & 1) * sides[a] + (child >> a & 1)
                    at_b = (n >> 1) * sides[b] + (child >> b & 1)
                    places.append((signs[1] * at_b, signs[0] * at_a, rows[n][1 + child], at_a, at_b))
            for _, _, packet, at_a, at_b in sorted(places):
                if packet != BEYOND:
                    fine.layer([(packet, _across(at_a, sides[a]) * _across(at_b, sides[b]))])
    return fine.emitted, coarse.emitted, fine.reflected, coarse.reflected


def _across(at: int, side: int) -> float:
    """How much a finer voxel is of a bundle's layer, by its place on one axis."""
    return ACROSS[at] if side == 2 else 1 / 2


def lit(reflected: Tensor, light: Tensor) -> float:
    """What is reflected by steps (codes, 4) of a light on each code."""
    return float(sum((reflected[:, n] * (light - n * STEP).clamp(0, STEP)).sum() for n in range(STEPS)))
