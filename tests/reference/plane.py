"""The 2-D table over density and strength in plain float64 torch."""

from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor

from volsplat.protocol.description.patches import Patch, Patches


class PlaneTable(NamedTuple):
    """All by strength, then density; colours are 0 where nothing is to be seen."""

    opacity: Tensor  # (256, 256)
    emit: Tensor  # (256, 256, 3)
    refl: Tensor


@lru_cache(8)  # of 4 MB each; a frame asks for its own once for each slab
def plane_table(patches: Patches) -> PlaneTable:
    opacities = torch.stack([_opacities(patch) for patch in patches])
    total = opacities.sum(dim=0)
    opacity = 1 - (1 - opacities).prod(dim=0)
    emit, refl = (_mixed(opacities, total, patches, name) for name in ("emit", "refl"))
    return PlaneTable(opacity, emit, refl)


def _opacities(patch: Patch) -> Tensor:
    place = torch.arange(256, dtype=torch.float64) / 255
    low, high = patch.strength
    up = ((place - low) / (high - low))[:, None]
    (left0, right0), (left1, right1) = patch.ends
    left, right = left0 + (left1 - left0) * up, right0 + (right1 - right0) * up
    inside = torch.minimum(_side(place, left, right, patch.soft), _side(place[:, None], low, high, patch.soft))
    return patch.opacity * inside


def _side(at: Tensor, low: Tensor | float, high: Tensor | float, soft: float) -> Tensor:
    low, high = torch.as_tensor(low, dtype=torch.float64), torch.as_tensor(high, dtype=torch.float64)
    rim = soft * (high - low) / 2
    up = torch.where((low <= 0) | (at - low >= rim), 1.0, (at - low) / rim)
    down = torch.where((high >= 1) | (high - at >= rim), 1.0, (high - at) / rim)
    return torch.where((at >= low) & (at <= high), torch.minimum(up, down), 0.0)


def _mixed(opacities: Tensor, total: Tensor, patches: Patches, name: str) -> Tensor:
    colours = torch.tensor([getattr(patch, name) for patch in patches], dtype=torch.float64)
    mixed = (opacities[..., None] * colours[:, None, None]).sum(dim=0) / total.clamp(min=1e-300)[..., None]
    return torch.where(total[..., None] > 0, mixed, 0.0)
