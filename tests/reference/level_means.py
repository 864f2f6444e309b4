"""The next coarser level of a volume in plain torch: means of 2x2x2 values and gradients, the second scalar of one."""

from itertools import product

import torch
from torch import Tensor

from reference.voxel_packets import directions, octahedral_codes, with_no_data_as_nan
from volsplat.protocol.rules.index_rules import AGREEMENTS, ROUGH_DIRECTIONS, ROUGH_NO_GRADIENT, ROUGH_SIDE
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT

BORDER = 1e-12  # how near to the border between two codes a sum is for another order of rounding to take it across


def halved(values: Tensor) -> Tensor:
    """float64 means of the finite ones of 2x2x2 values (k, j, i), NaN where there is none."""
    values = with_no_data_as_nan(values)
    k, j, i = ((n + 1) // 2 * 2 for n in values.shape)
    even = torch.full((k, j, i), torch.nan, dtype=torch.float64)
    even[: values.shape[0], : values.shape[1], : values.shape[2]] = values
    return even.reshape(k // 2, 2, j // 2, 2, i // 2, 2).nanmean(dim=(1, 3, 5))


def strongest(values: Tensor, second: Tensor) -> Tensor:
    """The second scalar of that voxel of 2x2x2 whose value is the greatest, the first of equals along k, j, i."""
    values = with_no_data_as_nan(values)
    chosen = second[::2, ::2, ::2].clone()
    greatest = torch.full(chosen.shape, -torch.inf, dtype=torch.float64)
    for dk, dj, di in product((0, 1), repeat=3):
        corner = values[dk::2, dj::2, di::2]
        there = tuple(slice(0, n) for n in corner.shape)
        greater = corner > greatest[there]
        greatest[there] = torch.where(greater, corner, greatest[there])
        chosen[there] = torch.where(greater, second[dk::2, dj::2, di::2], chosen[there])
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
    many, the less rough. The sum is moved by the nudge, in parts of it, before it is coded.
    """
    here = [finer[dk::2, dj::2, di::2] for dk, dj, di in product((0, 1), repeat=3)]
    mean_of = directions(scheme).clone()
    if scheme == "rough":
        mean_of[: len(AGREEMENTS) * ROUGH_DIRECTIONS] *= (
            torch.tensor(AGREEMENTS).double().repeat_interleave(ROUGH_DIRECTIONS)[:, None]
        )
    count = torch.zeros(packed.shape, dtype=torch.int64)
    strength, weight, total = count.clone(), count.clone(), torch.zeros((*packed.shape, 3), dtype=torch.float64)
    for corner in here:
        k, j, i = (slice(0, n) for n in corner.shape)
        there = corner >> NO_DATA_BIT == 0
        byte = torch.where(there, corner >> 8 & 255, 0)
        vector = mean_of[corner >> DIRECTION_SHIFT & 32767]
        counts = (there & vector.any(dim=-1)).long()
        count[k, j, i] += there
        strength[k, j, i] += byte
        weight[k, j, i] += counts
        total[k, j, i] += vector * counts[..., None]
    total += torch.tensor(nudge, dtype=torch.float64) * total.abs().sum(dim=-1, keepdim=True)
    agreement = total.norm(dim=-1) / weight.clamp(min=1)
    limits = [(one + other) / 2 for one, other in zip(AGREEMENTS, AGREEMENTS[1:], strict=False)]
    rough = sum((agreement < limit).long() for limit in limits)
    lit = total.any(dim=-1)
    code = octahedral_codes(torch.where(lit[..., None], total, 1.0), ROUGH_SIDE) + rough * ROUGH_DIRECTIONS
    code = torch.where(lit, code, ROUGH_NO_GRADIENT)
    byte = (strength / count.clamp(min=1) + 0.5).floor().long() if has_strength else packed >> 8 & 255
    return torch.where(packed >> NO_DATA_BIT == 0, packed & 255 | byte << 8 | code << DIRECTION_SHIFT, packed)
