"""The benchmarks' phantom: nested ellipsoid shells with noise, of which 10 to 15 % of the voxels are visible."""

from collections.abc import Iterator

import torch

from volsplat.client.phantoms.centred_grid import Phantom, SheetNoise, centred_geometry, sheet_positions
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable, ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector

SHELLS_SIZE: Index = (128, 128, 128)
AIR = 40.0
FIRST_VISIBLE = 100  # the least density byte that is not transparent
NOISE = 5.0
HALF_THICKNESS = 0.034  # of a shell's profile, in half extents of the grid

# Radius in half extents of the grid, density in the middle of the shell.
SHELLS = ((0.34, 235.0), (0.53, 205.0), (0.72, 175.0), (0.91, 150.0))


def shells(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """uint8 shells that fill the grid whatever its shape. Each is densest in its middle and fades to both sides."""
    geometry = centred_geometry(size or SHELLS_SIZE, spacing or (1.0, 1.0, 1.0))
    return Phantom(geometry, torch.uint8, _densities(geometry, SheetNoise(seed, NOISE)))


def _densities(geometry: Geometry, noise: SheetNoise) -> Iterator[torch.Tensor]:
    half = [max(-start, 0.5 * step) for start, step in zip(geometry.origin, geometry.spacing, strict=True)]
    for x, y, z in sheet_positions(geometry):
        radius = torch.sqrt((x / half[0]) ** 2 + (y / half[1]) ** 2 + (z / half[2]) ** 2)
        density = torch.full_like(radius, AIR)
        for middle, peak in SHELLS:
            profile = (1 - ((radius - middle) / HALF_THICKNESS) ** 2).clamp_(min=0)
            density += (peak - AIR) * profile
        density += noise.next(*density.shape)
        yield density.round_().clamp_(0, TABLE_ENTRIES - 1).to(torch.uint8)


def shells_tables() -> Tables:
    """Tables that show the shells, each in its own colour, and hide everything between them."""
    last = TABLE_ENTRIES - 1
    colours = (
        (FIRST_VISIBLE / last, (0.30, 0.18, 0.10)),
        (150 / last, (0.25, 0.45, 0.80)),
        (175 / last, (0.30, 0.75, 0.45)),
        (205 / last, (0.90, 0.75, 0.30)),
        (235 / last, (0.90, 0.30, 0.25)),
    )
    return Tables(
        emit=ColourTable(points=tuple((at, (r * 0.4, g * 0.4, b * 0.4)) for at, (r, g, b) in colours)),
        refl=ColourTable(points=colours),
        opac=ScalarTable(points=(((FIRST_VISIBLE - 1) / last, 0.0), (FIRST_VISIBLE / last, 0.05), (1.0, 0.5))),
    )
