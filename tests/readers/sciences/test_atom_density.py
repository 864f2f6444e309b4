"""Atoms as voxels: Gaussians of the right height and width, bonds, bands of elements, the same bits for any box."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from volsplat.mapshade_server.readers.molecules.atom_density import (
    BAND,
    BOND_TOLERANCE,
    CLASSES,
    COARSEST_SPACING,
    FINEST_SPACING,
    MOST_VOXELS_ASIDE,
    AtomGrid,
    Atoms,
    chosen_spacing,
    grid_around,
)
from volsplat.protocol.description.volume import Box

CARBON, NITROGEN, HYDROGEN, SULPHUR = ("C", 6.0, 0.73), ("N", 7.0, 0.71), ("H", 1.0, 0.31), ("S", 16.0, 1.05)
ELEMENTS = (CARBON, NITROGEN, HYDROGEN, SULPHUR)
Element = tuple[str, float, float]


def atoms(*given: tuple[Element, tuple[float, float, float]], alternatives: tuple[int, ...] = ()) -> Atoms:
    return Atoms(
        places=np.array([place for _, place in given], np.float64),
        radii=np.array([radius for (_, _, radius), _ in given]),
        heights=np.array([electrons for (_, electrons, _), _ in given]),
        classes=np.array([CLASSES.index(name) for (name, _, _), _ in given]),
        alternatives=np.array(alternatives or [0] * len(given)),
    )


def molecule(seed: int, count: int, extent: float) -> Atoms:
    generator = np.random.default_rng(seed)
    chosen = [ELEMENTS[n] for n in generator.integers(len(ELEMENTS), size=count)]
    places = generator.uniform(-extent, extent, (count, 3))
    return atoms(*((element, tuple(place)) for element, place in zip(chosen, places, strict=True)))


def test_one_atom_is_a_gaussian_as_high_as_its_electrons_and_half_its_radius_wide() -> None:
    one = atoms((CARBON, (1.5, -2.0, 3.25)))
    geometry = grid_around(one, 0.25)
    values = AtomGrid(one, geometry).density(geometry.box)
    k, j, i = np.indices(values.shape)
    steps = [axis * 0.25 + start for axis, start in zip((i, j, k), geometry.origin, strict=True)]
    square = sum((axis - centre) ** 2 for axis, centre in zip(steps, (1.5, -2.0, 3.25), strict=True))
    expected = 6.0 * np.exp(-square / (2 * 0.365**2))
    np.testing.assert_allclose(values, expected, rtol=tolerances.SPLAT_FLOAT32, atol=tolerances.SPLAT_FLOAT32)
    assert values.max() == 6.0 and values.dtype == np.float32
    assert max(values[0].max(), values[:, 0].max(), values[:, :, 0].max()) < tolerances.SAME_NUMBERS


def test_an_atom_is_never_too_narrow_for_its_grid() -> None:
    """Else its height would tell where it lies between the grid's points."""
    for offset in (0.0, 0.5):
        one = atoms((HYDROGEN, (offset, 0.0, 0.0)))
        geometry = grid_around(one, 1.0)
        values = AtomGrid(one, geometry).density(geometry.box)
        assert values.max() == pytest.approx(math.exp(-(offset**2) / (2 * 0.7**2)), rel=tolerances.SPLAT_FLOAT32)


def test_atoms_that_overlap_add_up_and_a_bond_joins_them() -> None:
    two = atoms((CARBON, (0.0, 0.0, 0.0)), (NITROGEN, (1.5, 0.0, 0.0)))
    geometry = grid_around(two, 0.25)
    i, j, k = (round(-start / 0.25) for start in geometry.origin)
    along = AtomGrid(two, geometry).density(geometry.box)[k, j, i : i + 7]
    alone = [
        6 * math.exp(-(x**2) / (2 * 0.365**2)) + 7 * math.exp(-((x - 1.5) ** 2) / (2 * 0.355**2)) for x in (0, 0.75)
    ]
    assert two.bonds.tolist() == [[0, 1]]
    assert alone[1] < 3.0
    assert along[0] == pytest.approx(alone[0], rel=tolerances.SPLAT_FLOAT32)
    assert along[3] == 3.0  # half of the lighter atom
    beside = AtomGrid(two, geometry).density(geometry.box)[k, j + 2, i + 3]
    assert beside < along[3] / 2


@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), extent=st.floats(0.5, 12.0))
def test_bonds_are_those_that_comparing_all_atoms_finds(seed: int, count: int, extent: float) -> None:
    some = molecule(seed, count, extent)
    expected = []
    for one in range(count):
        for other in range(one + 1, count):
            distance = math.dist(some.places[one], some.places[other])
            near = 0.4 <= distance <= some.radii[one] + some.radii[other] + BOND_TOLERANCE
            if near and not some.classes[one] == some.classes[other] == CLASSES.index("H"):
                expected.append([one, other])
    assert some.bonds.tolist() == expected


def test_alternatives_have_no_bonds_with_each_other() -> None:
    places = [(CARBON, (0.0, 0.0, 0.0)), (CARBON, (1.5, 0.0, 0.0)), (CARBON, (1.5, 0.6, 0.0))]
    assert atoms(*places, alternatives=(0, 65, 66)).bonds.tolist() == [[0, 1], [0, 2]]
    assert atoms(*places, alternatives=(65, 65, 66)).bonds.tolist() == [[0, 1]]


@given(data=st.data(), seed=st.integers(0, 10**6), spacing=st.floats(0.3, 1.2))
def test_any_box_has_the_bits_of_the_whole(data: st.DataObject, seed: int, spacing: float) -> None:
    some = molecule(seed, 12, 3.0)
    geometry = grid_around(some, spacing)
    grid = AtomGrid(some, geometry)
    low = tuple(data.draw(st.integers(0, size - 1)) for size in geometry.dims)
    high = tuple(data.draw(st.integers(least + 1, size)) for least, size in zip(low, geometry.dims, strict=True))
    box = Box((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    for made in (grid.density, grid.elements):
        whole, part = made(geometry.box), made(box)
        assert part.flags.c_contiguous
        np.testing.assert_array_equal(part, whole[low[2] : high[2], low[1] : high[1], low[0] : high[0]])


@pytest.mark.parametrize("element", ELEMENTS)
def test_an_element_has_its_own_band_out_to_the_covalent_radius(element: Element) -> None:
    name, _, radius = element
    one = atoms((element, (0.0, 0.0, 0.0)))
    geometry = grid_around(one, 0.1)
    values = AtomGrid(one, geometry).elements(geometry.box)
    band = CLASSES.index(name) * BAND
    assert values.max() == band + BAND - 1
    k, j, i = np.indices(values.shape)
    offsets = [axis * 0.1 + start for axis, start in zip((i, j, k), geometry.origin, strict=True)]
    distance = np.sqrt(sum(offset**2 for offset in offsets))
    assert not values[distance > radius].any()
    assert (values[distance < 0.99 * radius] >= band).all()


def test_bonds_and_atoms_meet_in_bands_without_mixing() -> None:
    two = atoms((CARBON, (0.0, 0.0, 0.0)), (NITROGEN, (1.75, 0.0, 0.0)))
    geometry = grid_around(two, 0.25)
    i, j, k = (round(-start / 0.25) for start in geometry.origin)
    along = [CLASSES[value // BAND] for value in AtomGrid(two, geometry).elements(geometry.box)[k, j, i : i + 8]]
    assert along == ["C", "C", "bond", "bond", "bond", "bond", "N", "N"]


@given(seed=st.integers(0, 10**6), extent=st.floats(1.0, 90.0))
def test_the_chosen_grid_is_fine_but_not_too_large(seed: int, extent: float) -> None:
    some = molecule(seed, 8, extent)
    spacing = chosen_spacing(some)
    assert FINEST_SPACING <= spacing <= COARSEST_SPACING
    if spacing < COARSEST_SPACING:
        assert max(grid_around(some, spacing).dims) <= MOST_VOXELS_ASIDE


def test_the_grid_is_at_multiples_of_its_spacing() -> None:
    geometry = grid_around(molecule(1, 5, 4.0), 0.25)
    assert all((start / 0.25).is_integer() for start in geometry.origin)
