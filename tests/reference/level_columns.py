"""What is seen of columns of a level's voxels and of those that they stand for, in plain float64."""

import math
from itertools import product

import torch
from torch import Tensor

from reference.level_means import sides_of
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT

BEYOND = (1 << 32) - 1
CODES = 1 << 15
APART = 0.25
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


def seen(
    column: Tensor,
    axis: int | None,
    from_high: bool,
    finer: Tensor,
    coarser: Tensor,
    sides: tuple[int, int, int] = (2, 2, 2),
) -> tuple[float, float, Tensor, Tensor]:
    """Emitted by the finer and the coarser voxels of one column, and reflected by direction code and step of the light.

    Tables have a layer's depth, what is emitted, and what is reflected of each step. A coarser voxel stands for so many
    finer ones along i, j, k; without an axis, of a diagonal, all these are one layer.
    """
    places = math.prod(sides) // (1 if axis is None else sides[axis])
    apart = 0.0 if axis is None else APART
    emitted, through = [0.0, 0.0], [1.0] * 10
    shares = [1 - apart, 1.0, *[apart / places] * 8]  # of finer layers, the coarser voxels, finer columns
    reflected = [torch.zeros((CODES, STEPS), dtype=torch.float64) for _ in range(2)]

    def layer(which: int, packets: list[int], table: Tensor, places: float) -> None:
        packets = [packet for packet in packets if packet >> NO_DATA_BIT == 0]
        total = sum(float(table[packet & 65535, 0]) for packet in packets)
        if total == 0.0:
            return
        stopped = through[which] * -math.expm1(-total / places)
        for packet in packets:
            depth, emit = table[packet & 65535, :2].tolist()
            part, level = shares[which] * stopped * depth / total, int(which == 1)
            emitted[level] += part * emit
            reflected[level][packet >> DIRECTION_SHIFT & CODES - 1] += part * table[packet & 65535, 2:]
        through[which] -= stopped

    for told in column.flip(0).tolist() if from_high else column.tolist():
        if max(through[:2]) <= 1 / 1024:
            break
        there = sum(packet != BEYOND for packet in told[1:])
        layer(1, told[:1], coarser, math.prod(sides) / there)
        for side in (None,) if axis is None else (1, 0) if from_high else (0, 1):
            packets = [packet for n, packet in enumerate(told[1:]) if side is None or n >> (axis or 0) & 1 == side]
            layer(0, packets, finer, places)
            for n, packet in enumerate(packets):
                layer(2 + n, [packet], finer, 1.0)
    return emitted[0], emitted[1], reflected[0], reflected[1]


def lit(reflected: Tensor, light: Tensor) -> float:
    """What is reflected by steps (codes, 4) of a light on each code."""
    return float(sum((reflected[:, n] * (light - n * STEP).clamp(0, STEP)).sum() for n in range(STEPS)))
