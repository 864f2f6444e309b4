"""The structure factors phantom: the reflections of a crystal of the protein phantom, three frequency dimensions.

Colour plate 3: "an image of the structure factors for super-oxide dismutase. The points were colored by phase angle
and the opacity depends the intensity." Here the crystal has the space group P 2(1) 2(1) 2(1), the most frequent one of
proteins (International Tables for Crystallography A, no. 19), with four molecules in its cell. The density of the cell
is made from the atoms and transformed by FFT: voxel (h, k, l) from the middle of the grid is the reflection (h, k, l).

A voxel's byte holds both parts, as the elements of the protein do: the phase chooses one of eight bands of 32 values,
sectors of 45 degrees from 0 up, and the amplitude rises within the band.
"""

import math

import torch
from torch import Tensor

from volsplat.client.phantoms.centred_grid import Phantom, at_once, centred_geometry
from volsplat.client.phantoms.molecule import Molecule
from volsplat.client.phantoms.protein import protein_atoms
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.matrices import Vector

STRUCTURE_FACTORS_SIZE: Index = (64, 64, 64)
CELL: Vector = (52.0, 56.0, 60.0)  # Å; about half of it is solvent, as in most crystals of proteins (Matthews 1968)
PLACE_IN_CELL: Vector = (0.21, 0.13, 0.08)  # of the molecule's middle: no place of symmetry, so that phases differ

# The four operations of P 2(1) 2(1) 2(1): the signs of x, y, z, and the shifts in cell edges.
OPERATIONS: tuple[tuple[Vector, Vector], ...] = (
    ((1, 1, 1), (0, 0, 0)),
    ((-1, -1, 1), (0.5, 0, 0.5)),
    ((-1, 1, -1), (0, 0.5, 0.5)),
    ((1, -1, -1), (0.5, 0.5, 0)),
)

TEMPERATURE_FACTOR = 10.0  # Å^2: atoms of a well-ordered protein shake so much (B = 8 pi^2 <u^2>)
OVERSAMPLING = 2  # of the density: reflections beyond the grid then hardly fold back into it
NARROWEST = 0.6  # steps of that density's grid: no standard deviation of an atom is less

SECTORS, BAND = 8, 32
PHASE_BANDS = tuple(
    Band(f"phase {360 * n // SECTORS} to {360 * (n + 1) // SECTORS} degrees", BAND * n, BAND * (n + 1) - 1)
    for n in range(SECTORS)
)
FULL_SHARE = 0.999  # of the reflections: stronger ones have the highest level


def reflections(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """uint8: the phase's sector times 32, plus the amplitude's level 0..31. F(000) is in the middle of the grid.

    Without a spacing it is that of the reciprocal lattice, in 1/Å.
    """
    size = size or STRUCTURE_FACTORS_SIZE
    geometry = centred_geometry(size, spacing or (1 / CELL[0], 1 / CELL[1], 1 / CELL[2]))
    values = at_once(lambda: _banded(structure_factors(size)))
    return Phantom(geometry, torch.uint8, values, Kind.STRUCTURE_FACTORS, PHASE_BANDS, "1/Å")


def _banded(factors: Tensor) -> Tensor:
    return _sector(factors) * BAND + _level(factors.abs())


def structure_factors(size: Index) -> Tensor:
    """F(h, k, l), complex64 shaped (l, k, h), each axis from -size // 2 up."""
    fine = (OVERSAMPLING * size[0], OVERSAMPLING * size[1], OVERSAMPLING * size[2])
    # The crystallographers' transform has exp(+2 pi i hx), that of the FFT exp(-2 pi i hx); the density is real.
    factors: Tensor = torch.fft.fftn(cell_density(protein_atoms(), fine)).conj()
    for axis, count in enumerate(size[::-1]):
        factors = factors.index_select(axis, (torch.arange(count) - count // 2) % factors.shape[axis])
    return factors


def cell_density(atoms: Molecule, size: Index) -> Tensor:
    """The electron density of one cell on a grid of the size, float32 (k, j, i): four molecules, and their neighbours'
    overhang."""
    values = torch.zeros(size[::-1])
    shares = atoms.places / torch.tensor(CELL, dtype=torch.float64) + torch.tensor(PLACE_IN_CELL, dtype=torch.float64)
    for signs, shifts in OPERATIONS:
        places = shares * torch.tensor(signs) + torch.tensor(shifts)
        x, y, z = (_periodic(places[:, axis], size[axis], CELL[axis]) for axis in range(3))
        weighted = atoms.electrons.float()[:, None] * z
        values += _summed(weighted, y, x)
    return values


def _summed(z: Tensor, y: Tensor, x: Tensor) -> Tensor:
    return torch.stack([(y * z[:, k, None]).T @ x for k in range(z.shape[1])])


def _periodic(places: Tensor, steps: int, edge: float) -> Tensor:
    """Each atom's Gaussian along an axis of the cell, wrapped around it: float32 (atoms, steps), of mean 1."""
    width = max(math.sqrt(TEMPERATURE_FACTOR / (8 * math.pi**2)), NARROWEST * edge / steps) / edge
    away = torch.arange(steps, dtype=torch.float64)[None, :] / steps - places[:, None]
    away = away - away.round()
    heights = sum((torch.exp(-0.5 * ((away + image) / width) ** 2) for image in (-1, 0, 1)), torch.zeros(()))
    return (heights / heights.mean(dim=1, keepdim=True)).float()


def _sector(factors: Tensor) -> Tensor:
    """Which of the SECTORS the phase lies in, uint8."""
    turns = torch.angle(factors) / (2 * math.pi)
    return (torch.floor((turns - turns.floor()) * SECTORS) % SECTORS).to(torch.uint8)


def _level(amplitudes: Tensor) -> Tensor:
    """0 for nothing, BAND - 1 for the strongest, uint8."""
    ordered = amplitudes.flatten().sort().values
    full = float(ordered[math.ceil(FULL_SHARE * (len(ordered) - 1))])
    share = amplitudes / full if full > 0 else torch.zeros_like(amplitudes)
    return (share.clamp(0, 1) * (BAND - 1)).round().to(torch.uint8)
