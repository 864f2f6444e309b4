"""Phantoms with a known formula: the Marschner-Lobb signal, a ramp and a slab."""

import math
from collections.abc import Iterator

import torch

from volsplat.client.phantoms.centred_grid import Phantom, centred_geometry, sheet_positions
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector, normalised

UNIT_SPACING: Vector = (1.0, 1.0, 1.0)

MARSCHNER_LOBB_SIZE: Index = (41, 41, 41)
MARSCHNER_LOBB_ALPHA = 0.25
MARSCHNER_LOBB_FREQUENCY = 6.0

RAMP_SIZE: Index = (48, 40, 32)
RAMP_DIRECTION: Vector = (0.48, 0.6, 0.64)  # of length 1, along no axis

SLAB_SIZE: Index = (48, 40, 32)
SLAB_MARGIN = 4  # voxels
SLAB_VALUE = 200


def marschner_lobb(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """The test signal of Marschner and Lobb (1994, section 5), float32 0..1; the grid spans [-1, 1] on each axis."""
    size = size or MARSCHNER_LOBB_SIZE
    own: Vector = (2 / max(size[0] - 1, 1), 2 / max(size[1] - 1, 1), 2 / max(size[2] - 1, 1))
    return Phantom(centred_geometry(size, spacing or own), torch.float32, _signal(centred_geometry(size, own)))


def _signal(unit: Geometry) -> Iterator[torch.Tensor]:
    return (marschner_lobb_signal(x, y, z) for x, y, z in sheet_positions(unit))


def marschner_lobb_signal(x: torch.Tensor, y: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    """The signal itself, 0..1, at any places of [-1, 1]^3."""
    radius = torch.sqrt(x * x + y * y)
    ripple = torch.cos(2 * math.pi * MARSCHNER_LOBB_FREQUENCY * torch.cos(math.pi * radius / 2))
    signal = 1 - torch.sin(math.pi * z / 2) + MARSCHNER_LOBB_ALPHA * (1 + ripple)
    return signal / (2 * (1 + MARSCHNER_LOBB_ALPHA))


def ramp(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """float32 values that rise by 1 per unit of length along RAMP_DIRECTION, 0 in the middle."""
    geometry = centred_geometry(size or RAMP_SIZE, spacing or UNIT_SPACING)
    dx, dy, dz = normalised(RAMP_DIRECTION)
    return Phantom(geometry, torch.float32, (dx * x + dy * y + dz * z for x, y, z in sheet_positions(geometry)))


def slab(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """uint8 SLAB_VALUE everywhere but in a margin of air, 0, which is thinner where the size leaves no room."""
    geometry = centred_geometry(size or SLAB_SIZE, spacing or UNIT_SPACING)
    within = []
    for count in geometry.dims:
        room = min(SLAB_MARGIN, (count - 1) // 2)
        index = torch.arange(count)
        within.append(((index >= room) & (index < count - room)).to(torch.uint8))
    sheet = within[1][:, None] * within[0][None, :] * SLAB_VALUE
    return Phantom(geometry, torch.uint8, (sheet[None] * inside for inside in within[2]))
