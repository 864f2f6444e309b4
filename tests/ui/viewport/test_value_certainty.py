"""What the page says of a value under the pointer holds of the value in the file."""

import math

import msgspec
from hypothesis import assume, given
from hypothesis import strategies as st

from support.pages.tables_page import VOLUME
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.value_certainty import Certainty, density_certainty, strength_certainty
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.messages.frame_messages import ProbedVoxel
from volsplat.protocol.rules.index_rules import Quantisation, Survey

SLACK = 1e-9  # of the range, for arithmetic


def volume_of(low: float, high: float, scalar_type: str, max_gradient: float = 900.0) -> SurveyedVolume:
    return SurveyedVolume(
        description=msgspec.structs.replace(VOLUME.description, scalar_type=scalar_type),
        survey=Survey(low=low, high=high, max_gradient=max_gradient, voxels=1000, no_data=0),
        density_counts=[1] * 1000,
        strength_counts=[1] * 1000,
        extremes=VOLUME.extremes,
    )


def drawn_as(quantisation: Quantisation, density: float, strength: float) -> ProbedVoxel:
    """The voxel as a server tells it, by the rule of the packets' bytes."""

    def byte(value: float, low: float, scale: float) -> int:
        return math.floor(min(max((value - low) * scale, 0.0), 255.0) + 0.5)

    low, _ = quantisation.window
    return ProbedVoxel(
        index=(0, 0, 0),
        density=quantisation.density_of_byte(byte(density, low, quantisation.density_scale)),
        strength=quantisation.strength_of_byte(byte(strength, 0.0, quantisation.strength_scale)),
    )


def holds(certainty: Certainty, told: float, value: float, half_step: float) -> bool:
    slack = half_step + SLACK * (abs(told) + half_step)
    match certainty:
        case Certainty.EXACT:
            return told == value
        case Certainty.ABOUT:
            return abs(value - told) <= slack
        case Certainty.AT_LEAST:
            return value >= told - slack
        case Certainty.AT_MOST:
            return value <= told + slack


@given(
    ends=st.tuples(st.integers(-3000, 3000), st.integers(-3000, 3000)),
    window=st.one_of(st.just("auto"), st.tuples(st.integers(-3000, 3000), st.integers(1, 3000))),
    scalar_type=st.sampled_from(["uint8", "int8", "int16", "uint16", "float32"]),
    share=st.floats(0, 1),
)
def test_what_is_said_of_a_value_holds_of_the_files(
    ends: tuple[int, int], window: str | tuple[int, int], scalar_type: str, share: float
) -> None:
    low, high = {"uint8": (0, 255), "int8": (-128, 127)}.get(scalar_type, (min(ends), max(ends)))
    assume(low < high)
    volume = volume_of(low, high, scalar_type)
    value = low + share * (high - low)
    if scalar_type != "float32":
        value = round(value)
    cut = Quantise() if isinstance(window, str) else Quantise(window=(float(window[0]), float(sum(window))))
    quantisation = volume.quantisation(cut)
    strength = share * volume.survey.max_gradient
    voxel = drawn_as(quantisation, value, strength)
    assert holds(density_certainty(voxel, volume, cut), voxel.density, value, 0.5 / quantisation.density_scale)
    assert holds(strength_certainty(voxel, volume), voxel.strength, strength, 0.5 / quantisation.strength_scale)


def test_bytes_are_told_as_they_are_and_metal_beyond_the_window_as_no_less() -> None:
    ct = volume_of(-1024.0, 3071.0, "int16")
    cut = Quantise(window=(-1000.0, 761.0))
    quantisation = ct.quantisation(cut)
    said = [density_certainty(drawn_as(quantisation, hu, 0.0), ct, cut) for hu in (3000.0, 40.0, -1024.0)]
    assert said == [Certainty.AT_LEAST, Certainty.ABOUT, Certainty.AT_MOST]
    eight_bits = volume_of(0.0, 255.0, "uint8")
    voxel = drawn_as(eight_bits.quantisation(Quantise()), 255.0, 0.0)
    assert (voxel.density, density_certainty(voxel, eight_bits, Quantise())) == (255.0, Certainty.EXACT)
