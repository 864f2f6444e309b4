"""Atoms on a grid: a synthetic electron density, or the elements as bands of density with bonds between the atoms.

Westover (1989) says of the hemoglobin in colour plate 3: "The map was generated from known atom centers, with bonds
added to the volume data in a separate process", and "the shading tables were chosen to color the density by atom
type". Both are made here by the rules that the readers of PDB and mmCIF files follow, so one scene suits both.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from volsplat.client.phantoms.centred_grid import axis_positions
from volsplat.protocol.description.kind import Band
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Vector

# Covalent radii in Å: Cordero et al., Dalton Trans. (2008) 2832, carbon's as in its double bonds. Atomic numbers are
# the heights of the Gaussians.
RADII = {"C": 0.73, "N": 0.71, "O": 0.66, "P": 1.07, "S": 1.05}
ELECTRONS = {"C": 6, "N": 7, "O": 8, "P": 15, "S": 16}

# Bands of 32 values, by their number: 0 is bond, and nothing at the value 0.
CLASSES = ("bond", "H", "C", "N", "O", "P", "S", "other")
BAND = 32
BANDS = tuple(Band(name, max(n * BAND, 1), (n + 1) * BAND - 1) for n, name in enumerate(CLASSES))

RIM = 2.0  # standard deviations in a covalent radius, where an element's band ends
NARROWEST = 0.7  # voxels: no standard deviation is less, or heights would depend on the grid
BOND_WIDTH = 0.2  # Å, standard deviation across
BOND_TOLERANCE = 0.4  # Å beyond the two radii


@dataclass(frozen=True)
class Molecule:
    """Elements and places in Å, float64 (n, 3)."""

    elements: tuple[str, ...]
    places: Tensor

    @cached_property
    def radii(self) -> Tensor:
        return torch.tensor([RADII[element] for element in self.elements], dtype=torch.float64)

    @cached_property
    def electrons(self) -> Tensor:
        return torch.tensor([ELECTRONS[element] for element in self.elements], dtype=torch.float64)

    @cached_property
    def bonds(self) -> list[tuple[int, int]]:
        """Pairs of atoms no farther apart than their radii and a little more."""
        reach = self.radii[:, None] + self.radii[None, :] + BOND_TOLERANCE
        near = torch.triu(torch.cdist(self.places, self.places) <= reach, diagonal=1)
        return [(int(one), int(other)) for one, other in torch.nonzero(near)]


def molecule(atoms: Sequence[tuple[str, Vector]]) -> Molecule:
    """The molecule of these atoms, its middle moved to the origin."""
    places = torch.tensor([place for _, place in atoms], dtype=torch.float64)
    middle = (places.amin(dim=0) + places.amax(dim=0)) / 2
    return Molecule(tuple(element for element, _ in atoms), places - middle)


def density(atoms: Molecule, geometry: Geometry, scale: float) -> Tensor:
    """float32 (k, j, i): a Gaussian for each atom, as high as it has electrons. `scale` is grid units per Å."""
    widths = _widths(atoms.radii, geometry, scale)
    x, y, z = (_gaussian(_along(atoms, geometry, scale, axis), widths) for axis in range(3))
    values = torch.empty(geometry.dims[::-1])
    for k in range(geometry.dims[2]):
        values[k] = (y * (atoms.electrons * z[:, k])[:, None]).T @ x
    return values


def elements(atoms: Molecule, geometry: Geometry, scale: float) -> Tensor:
    """uint8 (k, j, i) in bands of CLASSES that rise from the rim of an atom to its centre; 0 is nothing.

    A voxel belongs to the atom or bond whose Gaussian is the greatest there; a bond's counts half.
    """
    canvas = _Canvas(geometry, scale)
    for element, place, radius in zip(atoms.elements, atoms.places, atoms.radii, strict=True):
        canvas.claim(CLASSES.index(element), place, place, float(radius) / RIM, rank=1.0)
    for one, other in atoms.bonds:
        canvas.claim(CLASSES.index("bond"), atoms.places[one], atoms.places[other], BOND_WIDTH, rank=0.5)
    return canvas.values


class _Canvas:
    """The grid in Å, and who has claimed its voxels."""

    def __init__(self, geometry: Geometry, scale: float) -> None:
        self._axes = [axis_positions(geometry, axis).double() / scale for axis in range(3)]
        self._narrowest = NARROWEST * geometry.reference_spacing / scale
        self._greatest = torch.full(geometry.dims[::-1], _rim(), dtype=torch.float64)
        self.values = torch.zeros(geometry.dims[::-1], dtype=torch.uint8)

    def claim(self, band: int, start: Tensor, end: Tensor, width: float, rank: float) -> None:
        """Gives what lies near the line from start to end to a band, where nothing greater has claimed it."""
        width = max(width, self._narrowest)
        near = self._near(torch.minimum(start, end) - RIM * width, torch.maximum(start, end) + RIM * width)
        x, y, z = (
            axis[part].reshape(shape) - place
            for axis, part, place, shape in zip(
                self._axes, near[::-1], start, ((1, 1, -1), (1, -1, 1), (-1, 1, 1)), strict=True
            )
        )
        along = (end - start).tolist()
        length2 = sum(component * component for component in along)
        if length2 > 0:
            share = ((x * along[0] + y * along[1] + z * along[2]) / length2).clamp(0, 1)
            x, y, z = x - share * along[0], y - share * along[1], z - share * along[2]
        height = torch.exp((x * x + y * y + z * z) * (-0.5 / width**2))
        won = rank * height > self._greatest[near]
        self._greatest[near] = torch.where(won, rank * height, self._greatest[near])
        level = ((height - _rim()) / (1 - _rim())).clamp(0, 1) * (BAND - 1)
        claimed = (level.round() + BAND * band).to(torch.uint8)
        self.values[near] = torch.where(won, claimed, self.values[near])

    def _near(self, low: Tensor, high: Tensor) -> tuple[slice, slice, slice]:
        """The voxels (k, j, i) within a box in Å."""
        i, j, k = (
            slice(*torch.searchsorted(axis, torch.stack((low[n], high[n]))).tolist())
            for n, axis in enumerate(self._axes)
        )
        return k, j, i


def _rim() -> float:
    return float(torch.exp(torch.tensor(-0.5 * RIM**2, dtype=torch.float64)))


def _widths(radii: Tensor, geometry: Geometry, scale: float) -> Tensor:
    """Standard deviations in Å."""
    return (radii / RIM).clamp(min=NARROWEST * geometry.reference_spacing / scale)


def _along(atoms: Molecule, geometry: Geometry, scale: float, axis: int) -> Tensor:
    """Distances in Å along an axis, from each atom to each grid point: (atoms, points)."""
    return axis_positions(geometry, axis).double()[None, :] / scale - atoms.places[:, axis, None]


def _gaussian(distances: Tensor, widths: Tensor) -> Tensor:
    return torch.exp(-0.5 * (distances / widths[:, None]) ** 2)
