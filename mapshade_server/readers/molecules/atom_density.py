"""A molecule's atoms as voxels: a synthetic electron density, and the elements as bands of values.

Westover (1989), colour plate 3: "The map was generated from known atom centers, with bonds added to the volume data
in a separate process." Here an atom is a Gaussian as high as its element has electrons, times its occupancy. Two of
its standard deviations are the element's covalent radius (Cordero et al. 2008, as gemmi lists them), so that bonded
atoms meet where each has fallen to 14 %. Bonds join atoms that lie no farther apart than their radii and 0.4 Å; a bond
is a Gaussian across the line between its atoms, half as high as the lighter one. If atoms overlap they add up, a
bond shows where it is more than they are. Nothing is narrower than 0.7 voxel, or its height would depend on the grid.

For the elements, a voxel belongs to the atom that is the greatest there by its own height, out to the covalent radius
(to a bond where that is more than an atom's half). Its value lies in the band of that element: CLASSES has them, 32
values each, which rise from the rim to the centre; 0 is nothing. So a table tells elements by density, as in the paper.

The same bits for any box and on any machine: every voxel is made by the same single IEEE operations in the order of
the atoms. No file format is known here.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Geometry

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CLASSES = ("bond", "H", "C", "N", "O", "P", "S", "other")
BAND = 256 // len(CLASSES)  # values of each
BOND_CLASS, OTHER_CLASS = 0, len(CLASSES) - 1

RADII = 2.0  # standard deviations in a covalent radius
REACH = 5.0  # standard deviations; what lies beyond is less than 4e-6 of the height
BOND_WIDTH = 0.2  # standard deviation across, Å
BOND_HEIGHT = 0.5  # of the lighter atom's
BOND_TOLERANCE = 0.4  # Å beyond the radii, as is usual
LEAST_BOND = 0.4  # Å; nearer atoms are one atom's two places
NARROWEST = 0.7  # voxels
MOST_PAIRS = 512  # of an atom: twice what the largest ones in a solid have
FEW_PAIRS = 1 << 20  # in all, which always may be

MOST_VOXELS_ASIDE = 192  # of the grid that is chosen
FINEST_SPACING, COARSEST_SPACING = 0.2, 1.0  # Å, of that grid


@dataclass(frozen=True)
class Atoms:
    """n atoms: their places and covalent radii in Å, their electrons times occupancy, their class, and which
    alternative each belongs to (0: to all of them)."""

    places: Floats  # (n, 3)
    radii: Floats
    heights: Floats
    classes: Integers
    alternatives: Integers

    @property
    def crowded(self) -> bool:
        """Whether so many lie so near to each other that no room would do for the pairs that may be bonds."""
        pairs = sum(int(count.sum()) for _, count in _near_ranges(self.places, self._reach)[1])
        return pairs > max(FEW_PAIRS, MOST_PAIRS * len(self.places))

    @property
    def _reach(self) -> float:
        """How far apart bonded atoms are at most, Å."""
        return 2 * float(self.radii.max()) + BOND_TOLERANCE

    @cached_property
    def bonds(self) -> Integers:
        """Pairs of atoms (m, 2), the lower number first, in rising order."""
        first, second = _near_pairs(self.places, self._reach)
        apart = self.places[first] - self.places[second]
        distance = np.sqrt((apart * apart).sum(axis=1))
        hydrogen = self.classes == CLASSES.index("H")
        one, other = self.alternatives[first], self.alternatives[second]
        bonded = (
            (distance >= LEAST_BOND)
            & (distance <= self.radii[first] + self.radii[second] + BOND_TOLERANCE)
            & ~(hydrogen[first] & hydrogen[second])
            & ((one == other) | (one == 0) | (other == 0))
        )
        pairs = np.sort(np.stack([first[bonded], second[bonded]], axis=1), axis=1)
        return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def chosen_spacing(atoms: Atoms) -> float:
    """The grid's spacing in Å if nobody sets it, of two digits."""
    extent = float((atoms.places.max(axis=0) - atoms.places.min(axis=0)).max()) + 2 * REACH / RADII * atoms.radii.max()
    finest = float(f"{1.08 * extent / MOST_VOXELS_ASIDE:.1e}")
    return float(min(max(finest, FINEST_SPACING), COARSEST_SPACING))


def grid_around(atoms: Atoms, spacing: float) -> Geometry:
    """A grid of cubes around all that the atoms reach, its points at multiples of the spacing. Raises ValueError."""
    reach = REACH * _widths(atoms.radii, spacing).max()
    low = np.floor((atoms.places.min(axis=0) - reach) / spacing)
    high = np.ceil((atoms.places.max(axis=0) + reach) / spacing)
    i, j, k = (int(size) for size in high - low + 1)
    x, y, z = (float(start) for start in low * spacing)
    return Geometry(
        dims=(i, j, k),
        index_to_physical=((spacing, 0.0, 0.0), (0.0, spacing, 0.0), (0.0, 0.0, spacing)),
        origin=(x, y, z),
    )


class AtomGrid:
    """Atoms on a grid of cubes."""

    def __init__(self, atoms: Atoms, geometry: Geometry) -> None:
        self._atoms = atoms
        self._spacing = geometry.index_to_physical[0][0]
        self._origin = np.array(geometry.origin)
        self._widths = _widths(atoms.radii, self._spacing)
        self._bond_width = float(_widths(np.array([BOND_WIDTH * RADII]), self._spacing)[0])

    def density(self, box: Box) -> Voxels:
        """float32 (k, j, i): electrons, as the module says."""
        total = np.zeros(box.size[::-1])
        for atom, where, shape in self._atoms_in(box):
            total[where] += self._atoms.heights[atom] * shape
        for (one, other), where, shape in self._bonds_in(box):
            height = BOND_HEIGHT * min(self._atoms.heights[one], self._atoms.heights[other])
            np.maximum(total[where], height * shape, out=total[where])
        return total.astype(np.float32)

    def elements(self, box: Box) -> Voxels:
        """uint8 (k, j, i): bands of CLASSES, as the module says."""
        values = np.zeros(box.size[::-1], np.uint8)
        greatest = np.full(box.size[::-1], _gaussian(np.array([RADII])))
        for atom, where, shape in self._atoms_in(box):
            _claim(values[where], greatest[where], shape, shape, int(self._atoms.classes[atom]))
        for _, where, shape in self._bonds_in(box):
            _claim(values[where], greatest[where], 0.5 * shape, shape, BOND_CLASS)
        return values

    def _atoms_in(self, box: Box) -> Iterator[tuple[int, Any, Floats]]:
        """The atoms that reach into the box, with the part of it that they reach and their Gaussian there, 1 high."""
        low, high = self._reached(self._atoms.places, self._atoms.places, self._widths, box)
        for atom in np.nonzero((low < high).all(axis=1))[0]:
            inverse = 1.0 / self._widths[atom]
            ranges = [range(low[atom, axis], high[atom, axis]) for axis in range(3)]
            x, y, z = (
                _gaussian((self._along(axis, ranges[axis]) - self._atoms.places[atom, axis]) * inverse)
                for axis in range(3)
            )
            yield int(atom), _within(ranges, box), (z[:, None] * y)[:, :, None] * x

    def _bonds_in(self, box: Box) -> Iterator[tuple[tuple[int, int], Any, Floats]]:
        """Likewise for bonds: the Gaussian of the distance to the line between two atoms."""
        bonds = self._atoms.bonds
        ends = self._atoms.places[bonds]
        widths = np.full(len(bonds), self._bond_width)
        low, high = self._reached(ends.min(axis=1), ends.max(axis=1), widths, box)
        for bond in np.nonzero((low < high).all(axis=1))[0]:
            start, line = ends[bond, 0], ends[bond, 1] - ends[bond, 0]
            ranges = [range(low[bond, axis], high[bond, axis]) for axis in range(3)]
            x, y, z = (self._along(axis, ranges[axis]) - start[axis] for axis in range(3))
            x, y, z = x[None, None, :], y[None, :, None], z[:, None, None]
            share = (x * line[0] + y * line[1] + z * line[2]) / (line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
            share = np.minimum(np.maximum(share, 0.0), 1.0)
            dx, dy, dz = x - share * line[0], y - share * line[1], z - share * line[2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            yield (
                (int(bonds[bond, 0]), int(bonds[bond, 1])),
                _within(ranges, box),
                _gaussian(distance * (1.0 / self._bond_width)),
            )

    def _along(self, axis: int, indices: range) -> Floats:
        """The physical places of a grid axis's indices."""
        places: Floats = self._origin[axis] + np.arange(indices.start, indices.stop) * self._spacing
        return places

    def _reached(self, least: Floats, greatest: Floats, widths: Floats, box: Box) -> tuple[Integers, Integers]:
        """The half-open ranges of indices (n, 3) that things of these extents and widths reach, within the box."""
        reach = REACH * widths[:, None]
        low = np.ceil((least - reach - self._origin) / self._spacing).astype(np.int64)
        high = np.floor((greatest + reach - self._origin) / self._spacing).astype(np.int64) + 1
        return np.maximum(low, np.array(box.low)), np.minimum(high, np.array(box.high))


def _widths(radii: Floats, spacing: float) -> Floats:
    """Standard deviations in Å."""
    return np.maximum(radii / RADII, NARROWEST * spacing)


def _within(ranges: list[range], box: Box) -> tuple[slice, slice, slice]:
    k, j, i = (slice(ranges[axis].start - box.low[axis], ranges[axis].stop - box.low[axis]) for axis in (2, 1, 0))
    return k, j, i


def _claim(values: Voxels, greatest: Floats, rank: Floats, shape: Floats, band: int) -> None:
    """Gives the voxels where `rank` is the greatest yet to a class; their values say how high `shape` is."""
    won = rank > greatest
    greatest[won] = rank[won]
    rim = _gaussian(np.array([RADII]))
    level = np.minimum((shape[won] - rim) / (1.0 - rim), 1.0)
    values[won] = BAND * band + np.floor((BAND - 1) * np.maximum(level, 0.0) + 0.5).astype(np.uint8)


def _gaussian(x: Floats) -> Floats:
    """exp(-x²/2) for |x| <= 10 by multiplications and additions alone: numpy's own differs between machines."""
    v = x * x * (-0.5 / 64)
    power: Floats = np.full_like(v, 1 / 40320)
    for factor in (1 / 5040, 1 / 720, 1 / 120, 1 / 24, 1 / 6, 0.5, 1.0, 1.0):
        power = power * v + factor
    for _ in range(6):
        power = power * power
    return power


def _near_pairs(places: Floats, distance: float) -> tuple[Integers, Integers]:
    """All pairs of places that may lie within `distance`, each once: those in the same or neighbouring cells."""
    order, ranges = _near_ranges(places, distance)
    firsts, seconds = [], []
    for start, count in ranges:
        first = np.repeat(np.arange(len(order)), count)
        second = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(start, count)
        firsts.append(order[first])
        seconds.append(order[second])
    return np.concatenate(firsts), np.concatenate(seconds)


def _near_ranges(places: Floats, distance: float) -> tuple[Integers, list[tuple[Integers, Integers]]]:
    """The places in the order of their cells, then for each cell around where its places begin in that order, and how
    many there are, for each place; of its own cell those that come after it."""
    cells = np.floor((places - places.min(axis=0)) / distance).astype(np.int64) + 1
    strides = np.array([1, cells[:, 0].max() + 2, (cells[:, 0].max() + 2) * (cells[:, 1].max() + 2)])
    keys = cells @ strides
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    after = np.arange(1, len(keys) + 1)
    ranges = [(after, np.searchsorted(keys, keys, "right") - after)]
    for offset in (int(step @ strides) for step in _FORWARD):
        start = np.searchsorted(keys, keys + offset, "left")
        ranges.append((start, np.searchsorted(keys, keys + offset, "right") - start))
    return order, ranges


# The 13 of a cell's 26 neighbours that come after it; the others have it as theirs.
_FORWARD = [np.array([x, y, z]) for z in (0, 1) for y in (-1, 0, 1) for x in (-1, 0, 1) if (z, y, x) > (0, 0, 0)]
