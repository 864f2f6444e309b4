"""Phantoms with a known formula: the Marschner-Lobb signal, a ramp and a slab."""

import math

import torch

from volsplat.client.phantoms.centred_grid import centred_geometry, slabs
from volsplat.protocol.matrices import Vector, normalised
from volsplat.protocol.volume import Geometry, Index

UNIT_SPACING: Vector = (1.0, 1.0, 1.0)

MARSCHNER_LOBB_SIZE: Index = (41, 41, 41)
MARSCHNER_LOBB_ALPHA = 0.25
MARSCHNER_LOBB_FREQUENCY = 6.0

RAMP_SIZE: Index = (48, 40, 32)
RAMP_DIRECTION: Vector = (0.48, 0.6, 0.64)  # of length 1, along no axis

SLAB_SIZE: Index = (48, 40, 32)
SLAB_MARGIN = 4
SLAB_VALUE = 200


def make_marschner_lobb(
    size: Index | None = None, spacing: Vector | None = None, seed: int = 0
) -> tuple[torch.Tensor, Geometry]:
    """The test signal of Marschner and Lobb (1994, section 5), float32 0..1; the grid spans [-1, 1] on each axis."""
    size = size or MARSCHNER_LOBB_SIZE
    own: Vector = (2 / max(size[0] - 1, 1), 2 / max(size[1] - 1, 1), 2 / max(size[2] - 1, 1))
    unit = centred_geometry(size, own)
    values = torch.empty(size[::-1])
    for part, x, y, z in slabs(unit):
        radius = torch.sqrt(x * x + y * y)
        ripple = torch.cos(2 * math.pi * MARSCHNER_LOBB_FREQUENCY * torch.cos(math.pi * radius / 2))
        signal = 1 - torch.sin(math.pi * z / 2) + MARSCHNER_LOBB_ALPHA * (1 + ripple)
        values[part] = signal / (2 * (1 + MARSCHNER_LOBB_ALPHA))
    return values, centred_geometry(size, spacing or own)


def make_ramp(
    size: Index | None = None, spacing: Vector | None = None, seed: int = 0, direction: Vector = RAMP_DIRECTION
) -> tuple[torch.Tensor, Geometry]:
    """float32 values that rise by 1 per unit of length along `direction`, 0 in the middle."""
    geometry = centred_geometry(size or RAMP_SIZE, spacing or UNIT_SPACING)
    dx, dy, dz = normalised(direction)
    values = torch.empty(geometry.dims[::-1])
    for part, x, y, z in slabs(geometry):
        values[part] = dx * x + dy * y + dz * z
    return values, geometry


def make_slab(
    size: Index | None = None,
    spacing: Vector | None = None,
    seed: int = 0,
    margin: int = SLAB_MARGIN,
    value: int = SLAB_VALUE,
) -> tuple[torch.Tensor, Geometry]:
    """uint8 `value` everywhere but in a margin of air, 0, of so many voxels; less where the size leaves no room."""
    geometry = centred_geometry(size or SLAB_SIZE, spacing or UNIT_SPACING)
    within = []
    for count in geometry.dims:
        room = min(margin, (count - 1) // 2)
        index = torch.arange(count)
        within.append((index >= room) & (index < count - room))
    inside = within[2][:, None, None] & within[1][None, :, None] & within[0][None, None, :]
    return inside.to(torch.uint8) * value, geometry
