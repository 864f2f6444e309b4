"""Views by name, angles and quaternion: which physical direction faces where on the screen."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tolerances import ROTATION_ENTRY
from volsplat.protocol.description.view_rotation import (
    VIEW_NAMES,
    named_view,
    rotation_from_angles,
    rotation_from_option,
)
from volsplat.protocol.geometry import matrices
from volsplat.protocol.text.errors import BadInput

LEFT, POSTERIOR, UP = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
RIGHT, ANTERIOR, DOWN = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)

# The physical directions that point to the screen's right, up and to the viewer.
SIDES = {
    "front": (LEFT, UP, ANTERIOR),
    "back": (RIGHT, UP, POSTERIOR),
    "left": (POSTERIOR, UP, LEFT),
    "right": (ANTERIOR, UP, RIGHT),
    "top": (RIGHT, ANTERIOR, UP),
    "bottom": (LEFT, ANTERIOR, DOWN),
}


def entries(m: matrices.Matrix) -> tuple[float, ...]:
    return (*m[0], *m[1], *m[2])


def test_every_named_view_is_tested() -> None:
    assert set(VIEW_NAMES) == set(SIDES)


@pytest.mark.parametrize("name", VIEW_NAMES)
def test_a_named_view_shows_its_side(name: str) -> None:
    expected = matrices.transposed(matrices.transposed(SIDES[name]))
    rotation = matrices.rotation_from_quaternion(named_view(name))
    assert entries(rotation) == pytest.approx(entries(expected), abs=ROTATION_ENTRY)
    assert rotation_from_option(f" {name.upper()} ") == named_view(name)


def test_elevation_tips_the_top_towards_the_viewer_and_azimuth_turns_about_it() -> None:
    tipped = matrices.rotation_from_quaternion(rotation_from_angles(0, 30))
    assert matrices.applied(tipped, UP)[2] > 0
    turned = matrices.rotation_from_quaternion(rotation_from_angles(30, 0))
    assert matrices.applied(turned, UP) == pytest.approx((0, 1, 0), abs=ROTATION_ENTRY)
    assert matrices.applied(turned, ANTERIOR)[0] > 0  # counter-clockwise seen from above: the nose to the right
    rolled = matrices.rotation_from_quaternion(rotation_from_angles(0, 0, 30))
    assert matrices.applied(rolled, UP)[0] < 0  # counter-clockwise on the screen


@given(azimuth=st.floats(-720, 720), elevation=st.floats(-90, 90), roll=st.floats(-180, 180))
def test_angles_give_a_rotation(azimuth: float, elevation: float, roll: float) -> None:
    rotation = matrices.rotation_from_quaternion(rotation_from_angles(azimuth, elevation, roll))
    unity = matrices.product(rotation, matrices.transposed(rotation))
    assert entries(unity) == pytest.approx(entries(matrices.IDENTITY), abs=ROTATION_ENTRY)
    assert matrices.determinant(rotation) == pytest.approx(1, abs=ROTATION_ENTRY)


def test_the_option_takes_angles_and_quaternions() -> None:
    assert rotation_from_option("30,-10") == rotation_from_angles(30, -10)
    assert rotation_from_option("30, -10, 5") == rotation_from_angles(30, -10, 5)
    assert rotation_from_option("0,0,0,2") == (0.0, 0.0, 0.0, 2.0)


@pytest.mark.parametrize("text", ["", "up", "1", "1,2,3,4,5", "1,x", "nan,0", "inf,0,0,0", "0,0,0,0"])
def test_a_wrong_option_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(BadInput) as raised:
        rotation_from_option(text)
    assert str(raised.value).startswith(f"--rotate {text}:")
    assert "\n" not in str(raised.value)
