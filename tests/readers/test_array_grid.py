"""Arrays as volumes: names and indices of axes, order of axes, units."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from volsplat.mapshade_server.readers.arrays.array_grid import ArrayAxis, ArrayGrid, array_grid
from volsplat.mapshade_server.readers.arrays.array_part import array_part
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.length_units import length_unit


def grid_of(part: str, *axes: ArrayAxis) -> ArrayGrid:
    return array_grid(array_part("file", part), axes)


def plain(*lengths: int) -> list[ArrayAxis]:
    return [ArrayAxis(length) for length in lengths]


def named(names: str, *lengths: int) -> list[ArrayAxis]:
    along = (name if name in "xyz" else "" for name in names)
    return [ArrayAxis(*one) for one in zip(lengths, names, ("",) * 9, (0.0,) * 9, (1.0,) * 9, along, strict=False)]


def test_the_last_axis_is_i() -> None:
    grid = grid_of("", *plain(2, 3, 4))
    assert grid.geometry.dims == (4, 3, 2)
    assert grid.selection(Box((1, 0, 0), (4, 2, 1))) == (slice(0, 1), slice(0, 2), slice(1, 4))


def test_axes_one_long_are_dropped_from_the_front_but_not_those_of_space() -> None:
    assert grid_of("", *plain(1, 2, 1, 4)).indices == (0, None, None, None)
    assert grid_of("", *plain(2, 3, 4, 1)).indices == (None, None, None, 0)
    assert grid_of("", *named("tczyx", 1, 1, 1, 4, 5)).indices == (0, 0, None, None, None)
    assert grid_of("", *named("zcyx", 1, 1, 4, 5)).indices == (None, 0, None, None)


def test_indices_are_chosen_by_name_beginning_or_number() -> None:
    axes = [ArrayAxis(3, "time"), ArrayAxis(2, "c"), *named("zyx", 4, 5, 6)]
    for part in ("time=2,c=1", "t=2,c=1", "axis0=2,axis1=1", "c=1,TIME=2"):
        assert grid_of(part, *axes).indices == (2, 1, None, None, None)


def test_a_letter_for_each_axis_names_them() -> None:
    grid = grid_of("axes=xyzt,t=1,spacing=2x3x4", *plain(6, 5, 4, 2))
    assert grid.indices == (None, None, None, 1)
    assert grid.geometry.dims == (4, 5, 6)  # z is fastest
    assert grid.geometry.index_to_physical == ((0, 0, 2), (0, 3, 0), (4, 0, 0))


@given(order=st.permutations("xyz"))
def test_axes_lie_along_their_names_whatever_their_order(order: list[str]) -> None:
    lengths = {"x": 2, "y": 3, "z": 4}
    steps = {"x": 0.5, "y": -0.25, "z": 3.0}
    axes = [ArrayAxis(lengths[name], name, "mm", 10 * steps[name], steps[name], along=name) for name in order]
    grid = grid_of("", *axes)
    assert grid.geometry.dims == tuple(lengths[name] for name in reversed(order))
    last = tuple(float(length - 1) for length in grid.geometry.dims)
    assert grid.geometry.origin == (5.0, -2.5, 30.0)
    assert grid.geometry.physical((last[0], last[1], last[2])) == (5.5, -3.0, 39.0)
    assert grid.axes is None and grid.unit == "mm"


def test_a_depth_counts_against_its_axis() -> None:
    axes = [ArrayAxis(4, "depth", "m", 100.0, 10.0, along="z", down=True), *(ArrayAxis(4, n, "m") for n in "yx")]
    geometry = grid_of("", *axes).geometry
    assert geometry.physical((0, 0, 0))[2] == -100 and geometry.physical((0, 0, 3))[2] == -130


def test_units_of_length_become_the_first_one() -> None:
    axes = (ArrayAxis(2, "z", "micrometer", step=2.0), ArrayAxis(2, "y", "nm", step=500.0), ArrayAxis(2, "x", "um"))
    grid = grid_of("", *axes)
    assert grid.geometry.spacing == (1.0, 0.5, 2.0) and grid.unit == "µm"
    assert grid_of("unit=px", *axes).unit == "px"


def test_axes_without_a_common_unit_are_told_and_drawn_alike() -> None:
    axes = (ArrayAxis(2, "time", "ms", 8.0, -4.0), ArrayAxis(2, "y", "m", 5.0, 25.0), ArrayAxis(2, "x", "km", 1.0, 0.1))
    grid = grid_of("", *axes)
    assert np.allclose(grid.geometry.spacing, (0.1, 0.025, 0.05))
    assert grid.geometry.index_to_physical[2][2] < 0
    assert grid.unit == "" and "no unit in common (x in km, y in m, time in ms)" in grid.warnings[0]
    assert grid.axes is not None
    assert [(axis.name, axis.unit, axis.first, axis.step) for axis in grid.axes] == [
        ("x", "km", 1.0, 0.1),
        ("y", "m", 5.0, 25.0),
        ("time", "ms", 8.0, -4.0),
    ]
    assert grid_of("", *(ArrayAxis(2, n, n, step=9.0) for n in "abc")).geometry.spacing == (1, 1, 1)


def test_a_given_spacing_keeps_the_directions_of_the_axes() -> None:
    axes = (ArrayAxis(2, "z", "m", 7.0, -3.0), ArrayAxis(2, "y", "s"), ArrayAxis(2, "x", "K"))
    grid = grid_of("spacing=1x2x3,unit=mm", *axes)
    assert grid.geometry.index_to_physical == ((1, 0, 0), (0, 2, 0), (0, 0, -3))
    assert grid.geometry.origin == (0, 0, 0) and grid.unit == "mm" and not grid.warnings


def test_the_same_unit_of_another_kind_is_kept() -> None:
    assert grid_of("", *(ArrayAxis(2, n, "1/nm", step=9.0) for n in "hkl")).unit == "1/nm"


@pytest.mark.parametrize(
    ("part", "axes", "cause"),
    [
        ("", plain(4, 5), "file: a 2-D image, volsplat needs a volume: its axes are axis0 (4 long), axis1 (5 long)"),
        ("data", plain(4), "file#data: a 1-D list"),
        ("", [], "a single number"),
        ("", plain(4, 0, 5), "holds no voxels"),
        ("", plain(4, 5, 6, 3), "choose an index of axis3, as in file#axis3=0"),
        ("", plain(9, 5, 6, 7), "choose an index of axis0, as in file#axis0=0"),
        ("data,c=1", named("tczyx", 3, 2, 4, 5, 6), "choose an index of t, as in file#data,c=1,t=0"),
        ("", named("tczyx", 3, 2, 4, 5, 6), "choose an index of t and of c, as in file#t=0,c=0"),
        ("z=1", named("zyx", 4, 5, 6), "a 2-D image after the choice of indices"),
        ("t=3", named("tzyx", 3, 4, 5, 6), "“t=3” is beyond the axis, whose last index is 2"),
        ("t=first", named("tzyx", 3, 4, 5, 6), "“t=first” needs one number"),
        ("t=-1", named("tzyx", 3, 4, 5, 6), "“t=-1” needs one whole number, 0 or more"),
        ("q=1", named("tzyx", 3, 4, 5, 6), "“q=1” names no axis; the axes are t (3 long), z (4 long)"),
        ("axes=xy", plain(4, 5, 6), "needs 3 different letters"),
        ("axes=xyy", plain(4, 5, 6), "needs 3 different letters"),
        ("", [ArrayAxis(2, step=0.0), *plain(2, 2)], "give it yourself, as in file#spacing=1x1x1"),
        ("", [ArrayAxis(2, step=float("nan")), *plain(2, 2)], "its spacing cannot be used"),
        ("", [ArrayAxis(2, first=float("inf")), *plain(2, 2)], "the origin is not finite"),
    ],
)
def test_what_is_no_volume_is_refused(part: str, axes: list[ArrayAxis], cause: str) -> None:
    with pytest.raises(BadInput) as refusal:
        grid_of(part, *axes)
    assert cause in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_path_may_hold_commas_and_equals_signs() -> None:
    part = array_part("file", "a,b/c,t=1,spacing=1,2,3,d=4")
    assert part.path == "a,b/c" and part.options == {"t": "1", "spacing": "1,2,3", "d": "4"}
    assert array_part("file", "run 1=a/b").path == "run 1=a/b"


def test_a_path_is_asked_for_where_it_looks_like_options_the_longest_first() -> None:
    asked = list[str]()

    def is_path(path: str) -> bool:
        asked.append(path)
        return path == "a,b,c=d"

    assert array_part("file", "a,b", is_path).path == "a,b" and asked == []
    part = array_part("file", "a,b,c=d,t=1,u=2", is_path)
    assert (part.path, part.options) == ("a,b,c=d", {"t": "1", "u": "2"})
    assert asked == ["a,b,c=d,t=1,u=2", "a,b,c=d,t=1", "a,b,c=d"]


@pytest.mark.parametrize(
    ("text", "symbol", "metres"),
    [
        ("micrometer", "µm", 1e-6),
        ("um", "µm", 1e-6),
        ("MICRONS", "µm", 1e-6),
        ("\u03bcm", "µm", 1e-6),
        ("mm", "mm", 1e-3),
        ("Millimetres", "mm", 1e-3),
        ("Mm", "Mm", 1e6),
        ("angstrom", "Å", 1e-10),
        ("meter", "m", 1.0),
        ("km", "km", 1e3),
        ("parsec", "pc", 3.0856775814913673e16),
    ],
)
def test_units_of_length_have_many_names(text: str, symbol: str, metres: float) -> None:
    assert length_unit(text) == (symbol, metres)


@pytest.mark.parametrize("text", ["", "s", "deg", "pixel", "MM"])
def test_other_units_are_no_lengths(text: str) -> None:
    assert length_unit(text) is None
