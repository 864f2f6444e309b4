"""The next coarser level of a volume in plain torch: means of up to 2x2x2 values and gradients, the second scalar of
one."""

from collections.abc import Sequence
from itertools import product

import torch
from torch import Tensor

from reference.voxel_packets import directions, octahedral_codes, with_no_data_as_nan
from volsplat.protocol.rules.index_rules import (
    AGREEMENTS,
    FIRST_TWO_FACED,
    ROUGH_DIRECTIONS,
    ROUGH_NO_GRADIENT,
    ROUGH_SIDE,
    ROUGHNESS_COSINES,
    TWO_FACED_SIDE,
)
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT

BORDER = 1e-12  # how near to the border between two codes a sum is for another order of rounding to take it across


Sides = tuple[int, ...]  # voxels along k, j, i that one of the level is made of

CUBE: Sides = (2, 2, 2)


def sides_of(finer: Sequence[int], coarser: Sequence[int]) -> Sides:
    """Of two levels that have so many voxels along k, j, i."""
    return tuple(1 if fine == coarse else 2 for fine, coarse in zip(finer, coarser, strict=True))


def corners(sides: Sides) -> "product[tuple[int, ...]]":
    """Where the voxels lie of which one of the level is made, the first of them at 0, 0, 0."""
    return product(*map(range, sides))


def corner_of(finer: Tensor, sides: Sides, corner: Sides) -> Tensor:
    """Of every voxel of the level the one in this corner, fewer where the volume ends."""
    return finer[tuple(slice(at, None, side) for at, side in zip(corner, sides, strict=True))]


def halved(values: Tensor, sides: Sides = CUBE) -> Tensor:
    """float64 means of the finite ones of so many values (k, j, i), NaN where there is none."""
    values = with_no_data_as_nan(values)
    sizes = [-(-n // side) for n, side in zip(values.shape, sides, strict=True)]
    even = torch.full([n * side for n, side in zip(sizes, sides, strict=True)], torch.nan, dtype=torch.float64)
    even[: values.shape[0], : values.shape[1], : values.shape[2]] = values
    (k, j, i), (dk, dj, di) = sizes, sides
    return even.reshape(k, dk, j, dj, i, di).nanmean(dim=(1, 3, 5))


def strongest(values: Tensor, second: Tensor, sides: Sides = CUBE) -> Tensor:
    """The second scalar of that voxel of so many whose value is the greatest, the first of equals along k, j, i."""
    values = with_no_data_as_nan(values)
    chosen = corner_of(second, sides, (0, 0, 0)).clone()
    greatest = torch.full(chosen.shape, -torch.inf, dtype=torch.float64)
    for at in corners(sides):
        corner = corner_of(values, sides, at)
        there = tuple(slice(0, n) for n in corner.shape)
        greater = corner > greatest[there]
        greatest[there] = torch.where(greater, corner, greatest[there])
        chosen[there] = torch.where(greater, corner_of(second, sides, at), chosen[there])
    return chosen


def is_with_gradients_of(finer: Tensor, scheme: str, packed: Tensor, found: Tensor) -> bool:
    """Whether what was found is `with_gradients_of`; a sum on the border between two codes may have either."""
    nudges = product((-BORDER, BORDER), repeat=3)
    allowed = (with_gradients_of(finer, scheme, packed, nudge=nudge) for nudge in nudges)
    same = with_gradients_of(finer, scheme, packed) == found
    for one in () if same.all() else allowed:
        same |= one == found
    return bool(same.all())


def with_gradients_of(
    finer: Tensor,
    scheme: str,
    packed: Tensor,
    has_strength: bool = True,
    nudge: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> Tensor:
    """Packets (k, j, i) int64 of a level with gradients of the level before, `finer`, in place of their own.

    Strength is the mean of up to eight, direction that of the sum of their unit vectors; the longer that is, for so
    many, the less rough. If they cancel, and more than 0.85 of their squares lies along an axis, this is the
    direction. The sum, and the axis, is moved by the nudge, in parts of it, before it is coded.
    """
    sides = sides_of(finer.shape, packed.shape)
    here = [corner_of(finer, sides, at) for at in corners(sides)]
    has_direction = directions(scheme).any(dim=-1)
    mean_of, square_of = directions(scheme).clone(), directions(scheme)[:, :, None] * directions(scheme)[:, None, :]
    if scheme == "rough":
        mean_of[:FIRST_TWO_FACED] *= torch.tensor(AGREEMENTS).double().repeat_interleave(ROUGH_DIRECTIONS)[:, None]
        mean_of[FIRST_TWO_FACED:] = 0.0
        along = torch.tensor(ROUGHNESS_COSINES).double().square().mean(dim=1)
        along = along.repeat_interleave(ROUGH_DIRECTIONS)[:, None, None]
        rough_squares = square_of[:FIRST_TWO_FACED]
        square_of[:FIRST_TWO_FACED] = along * rough_squares + (1 - along) / 2 * (torch.eye(3) - rough_squares)
    count = torch.zeros(packed.shape, dtype=torch.int64)
    strength, weight, total = count.clone(), count.clone(), torch.zeros((*packed.shape, 3), dtype=torch.float64)
    squares = torch.zeros((*packed.shape, 3, 3), dtype=torch.float64)
    for corner in here:
        k, j, i = (slice(0, n) for n in corner.shape)
        there = corner >> NO_DATA_BIT == 0
        byte = torch.where(there, corner >> 8 & 255, 0)
        codes = corner >> DIRECTION_SHIFT & 32767
        counts = (there & has_direction[codes]).long()
        count[k, j, i] += there
        strength[k, j, i] += byte
        weight[k, j, i] += counts
        total[k, j, i] += mean_of[codes] * counts[..., None]
        squares[k, j, i] += square_of[codes] * counts[..., None, None]
    total += torch.tensor(nudge, dtype=torch.float64) * total.abs().sum(dim=-1, keepdim=True)
    agreement = total.norm(dim=-1) / weight.clamp(min=1)
    limits = [(one + other) / 2 for one, other in zip(AGREEMENTS, AGREEMENTS[1:], strict=False)]
    rough = sum((agreement < limit).long() for limit in limits)
    lit = total.any(dim=-1)
    code = octahedral_codes(torch.where(lit[..., None], total, 1.0), ROUGH_SIDE) + rough * ROUGH_DIRECTIONS
    code = torch.where(lit, code, ROUGH_NO_GRADIENT)
    cancel = (weight > 0) & (agreement < limits[-1])
    shares, axes = torch.linalg.eigh(squares[cancel] / weight[cancel][:, None, None])
    axis = (
        axes[:, :, 2] * torch.where(axes[:, :, 2] @ torch.tensor([1.0, 2.0, 3.0]).double().sqrt() < 0, -1, 1)[:, None]
    )
    axis += torch.tensor(nudge, dtype=torch.float64)
    two_faced = FIRST_TWO_FACED + octahedral_codes(axis, TWO_FACED_SIDE)
    code[cancel] = torch.where(shares[:, 2] > 0.85, two_faced, code[cancel])
    byte = (strength / count.clamp(min=1) + 0.5).floor().long() if has_strength else packed >> 8 & 255
    return torch.where(packed >> NO_DATA_BIT == 0, packed & 255 | byte << 8 | code << DIRECTION_SHIFT, packed)
