"""The galaxy phantom: the spectral cube of an inclined, rotating, warped disc of gas.

Colour plate 4 shows a Fabry-Perot map of a galaxy: two axes on the sky, one of wavelength, that is of velocity along
the line of sight. The disc is thin and has two logarithmic arms; its rotation curve is that of a spiral galaxy such as
NGC 2403 (de Blok et al., Astron. J. 136 (2008) 2648), which stays flat as far out as there is gas.
"""

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from volsplat.client.phantoms.centred_grid import Phantom, SheetNoise, placed_grid, sheet_positions
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector

GALAXY_SIZE: Index = (100, 100, 80)
FIELD_OF_VIEW: Vector = (100.0, 100.0, 80.0)  # lengths are pixels and channels of the default size
CHANNEL_WIDTH = 4.2  # km/s

INCLINATION = math.radians(50.0)
POSITION_ANGLE = math.radians(35.0)  # of the receding side, counter-clockwise from +x
FLAT_ROTATION = 150.0  # km/s
TURNOVER = 9.0  # pixels: the rotation curve is the arctangent of Courteau, Astron. J. 114 (1997) 2402
DISPERSION = 10.0  # km/s, of neutral hydrogen (Tamburro et al., Astron. J. 137 (2009) 4424)

SCALE_LENGTH = 19.0  # pixels, of the exponential disc (Freeman, Astrophys. J. 160 (1970) 811)
EDGE, EDGE_WIDTH = 42.0, 2.5  # where the gas ends
HOLE = 3.0  # the middle is poor in gas
ARMS, PITCH = 2, math.radians(18.0)
ARM_CONTRAST = 0.75
WARP_FROM, WARP = 24.0, math.radians(22.0)  # beyond this radius the major axis turns, by so much at the edge
NOISE = 0.006  # of the greatest brightness


def galaxy(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """float32 brightness, 1 at most but for the noise: x and y on the sky, velocity along z, rising away from us."""
    geometry, scale = placed_grid(size or GALAXY_SIZE, spacing, FIELD_OF_VIEW)
    return Phantom(geometry, torch.float32, _observed(geometry, scale, SheetNoise(seed, NOISE)))


def _observed(geometry: Geometry, scale: float, noise: SheetNoise) -> Iterator[Tensor]:
    for x, y, z in sheet_positions(geometry):
        column, velocity = column_density(x / scale, y / scale), line_of_sight_velocity(x / scale, y / scale)
        line = torch.exp(-0.5 * ((z / scale * CHANNEL_WIDTH - velocity) / DISPERSION) ** 2)
        brightness = column * line
        yield brightness + noise.next(*brightness.shape)


def column_density(x: Tensor, y: Tensor) -> Tensor:
    """Gas along the line of sight through a pixel, 0..1."""
    radius, angle = _in_disc(x, y)
    disc = torch.exp(-radius / SCALE_LENGTH) * torch.sigmoid((EDGE - radius) / EDGE_WIDTH)
    disc = disc * (1 - torch.exp(-((radius / HOLE) ** 2)))
    crest = torch.cos(ARMS * (angle - torch.log(radius.clamp(min=0.5)) / math.tan(PITCH)))
    return disc * (1 + ARM_CONTRAST * crest) / (1 + ARM_CONTRAST)


def line_of_sight_velocity(x: Tensor, y: Tensor) -> Tensor:
    """km/s away from us, in a pixel."""
    radius, angle = _in_disc(x, y)
    return rotation_speed(radius) * math.sin(INCLINATION) * torch.cos(angle)


def rotation_speed(radius: Tensor) -> Tensor:
    """km/s at a distance in pixels from the centre."""
    return FLAT_ROTATION * 2 / math.pi * torch.atan(radius / TURNOVER)


def _in_disc(x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Radius in the disc's plane, and the angle in it from the receding side of the major axis."""
    flat, _ = _deprojected(x, y, torch.zeros(()))
    turn = WARP * ((flat - WARP_FROM) / (EDGE - WARP_FROM)).clamp(0, 1)
    return _deprojected(x, y, turn)


def _deprojected(x: Tensor, y: Tensor, turn: Tensor) -> tuple[Tensor, Tensor]:
    axis = POSITION_ANGLE + turn
    major = x * torch.cos(axis) + y * torch.sin(axis)
    minor = (y * torch.cos(axis) - x * torch.sin(axis)) / math.cos(INCLINATION)
    return torch.sqrt(major * major + minor * minor), torch.atan2(minor, major)
