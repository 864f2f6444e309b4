"""The 12-bit opacity code and the fields of packets and runs."""

from fractions import Fraction

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference.render import coded
from tolerances import CODE_TIE, ROUNDING
from volsplat.protocol.rules import packet_layout
from volsplat.protocol.rules.packet_layout import OPACITY_CODES, OPACITY_UNIT, code_of_opacity, opacity_of_code

EVERY_CODE = [opacity_of_code(code) for code in range(OPACITY_CODES)]


def test_codes_rise_from_0_to_exactly_1() -> None:
    assert EVERY_CODE[0] == 0
    assert EVERY_CODE[-1] == 1
    assert all(low < high for low, high in zip(EVERY_CODE, EVERY_CODE[1:], strict=False))


def test_every_code_is_the_code_of_its_opacity() -> None:
    assert [code_of_opacity(opacity) for opacity in EVERY_CODE] == list(range(OPACITY_CODES))


@given(st.one_of(st.floats(0, 1), st.floats(0, 1e-3), st.floats(0, 1e-6)))
def test_code_of_an_opacity_is_the_nearest(opacity: float) -> None:
    got = code_of_opacity(opacity)
    nearest = min(abs(Fraction(opacity) - Fraction(value)) for value in EVERY_CODE)
    assert abs(Fraction(opacity) - Fraction(EVERY_CODE[got])) <= nearest + Fraction(CODE_TIE) / OPACITY_UNIT


@pytest.mark.parametrize("code", [0, 1, 254, 255, 256, 511, 512, 2000, 4094])
def test_halves_are_rounded_up(code: int) -> None:
    assert code_of_opacity((EVERY_CODE[code] + EVERY_CODE[code + 1]) / 2) == code + 1


@given(st.floats(2**-14, 1))
def test_code_is_within_a_five_hundredth_of_any_opacity_that_shows(opacity: float) -> None:
    relative_step = 1 / 256
    assert opacity_of_code(code_of_opacity(opacity)) == pytest.approx(opacity, rel=relative_step / 2 + ROUNDING)


def test_opacities_outside_0_to_1_are_clamped() -> None:
    assert code_of_opacity(-0.5) == 0
    assert code_of_opacity(1.5) == OPACITY_CODES - 1


@given(st.lists(st.floats(0, 1), min_size=1))
def test_reference_codes_like_the_rule(opacities: list[float]) -> None:
    tensor = torch.tensor(opacities, dtype=torch.float64)
    expected = torch.tensor([opacity_of_code(code_of_opacity(opacity)) for opacity in opacities]).double()
    step = torch.maximum(tensor / 256, torch.tensor(1.0 / OPACITY_UNIT))
    assert ((coded(tensor) - tensor).abs() <= step / 2 + CODE_TIE / OPACITY_UNIT).all()
    assert ((coded(tensor) - expected).abs() <= step).all()


def test_fields_fill_a_shaded_packet_without_gap() -> None:
    assert 2 * packet_layout.POSITION_BITS == packet_layout.OPACITY_SHIFT
    assert 1 << (packet_layout.COLOUR_SHIFT - packet_layout.OPACITY_SHIFT) == OPACITY_CODES
    assert packet_layout.COLOUR_SHIFT + 3 * 8 == 8 * packet_layout.SHADED_PACKET_BYTES
    assert packet_layout.ROW_RUN_BYTES == 24
    assert 1 << (packet_layout.POSITION_BITS - packet_layout.SUBPIXEL_BITS) == 256  # pixels that a run spans
