"""The legend of structure factors: which scenes have one, and its colours where phases lie."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from volsplat.client.histogram.subject import Subject, subject_of
from volsplat.client.image.phase_wheel import LEAST_RING, phase_legend, phase_wheel, wheel_colours
from volsplat.client.scene.glow_scenes import phase_colours, structure_factors_scene
from volsplat.client.scene.presets import preset_scene
from volsplat.client.ui.panels.phase_legend import gradient
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.rules.index_rules import Survey

FOUR = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0))


def described(**changes: object) -> VolumeDescription:
    return VolumeDescription(
        name="made",
        format="test",
        geometry=Geometry((8, 8, 8)),
        scalar_type="uint8",
        kind=Kind.STRUCTURE_FACTORS,
        **changes,  # type: ignore[arg-type]
    )


def subject(description: VolumeDescription) -> Subject:
    survey = Survey(low=0.0, high=255.0, max_gradient=1.0, voxels=256, no_data=0)
    return subject_of(description, survey, [1] * 256, (0.0, 255.0))


WITH_PHASES = described(second_scalar=(0.0, 360.0), strength_name="phase")
IN_BANDS = described(bands=tuple(Band(f"{n}", 64 * n, 64 * n + 63) for n in range(4)))


def test_phases_as_second_scalar_have_the_wheel_of_their_table() -> None:
    colours = wheel_colours(WITH_PHASES, structure_factors_scene(subject(WITH_PHASES)))
    assert colours is not None
    entries = phase_colours().entries()
    for share in (0.1, 0.4, 0.8):
        near = colours[int(share * len(colours))]
        assert near == pytest.approx(entries[round(share * 255)], abs=0.15)


def test_phases_in_bands_have_a_sector_each() -> None:
    scene = structure_factors_scene(subject(IN_BANDS))
    colours = wheel_colours(IN_BANDS, scene)
    emitted = scene.tables.emit.entries()
    assert colours == tuple(emitted[64 * n + 32] for n in range(4)) and len(set(colours)) == 4


def test_what_is_not_coloured_by_phase_has_no_wheel() -> None:
    plain = described()
    assert wheel_colours(plain, structure_factors_scene(subject(plain))) is None
    for coloured in (WITH_PHASES, IN_BANDS):
        assert wheel_colours(coloured, preset_scene("depth-cue", subject(coloured))) is None
    assert wheel_colours(described(strength_name="phase"), structure_factors_scene(subject(WITH_PHASES))) is None


def test_the_wheel_begins_at_the_right_and_turns_against_the_clock() -> None:
    side = 101
    wheel = phase_wheel(FOUR, side)
    assert wheel.shape == (side, side, 4)
    middle, radius = side // 2, round(0.8 * side / 2)
    for n, colour in enumerate(FOUR):
        angle = 2 * math.pi * (n + 0.5) / len(FOUR)
        x, y = middle + round(radius * math.cos(angle)), middle - round(radius * math.sin(angle))
        assert wheel[y, x].tolist() == [*colour, 1.0]
    assert wheel[middle, middle, 3] == wheel[0, 0, 3] == 0


def test_the_legend_for_sheets_has_the_wheel_and_words_about_it() -> None:
    legend = torch.from_numpy(phase_legend(FOUR, 200))
    assert legend.shape == (200, 200, 3) and 0 <= float(legend.min()) <= float(legend.max()) <= 1
    grey = (legend.amax(dim=2) - legend.amin(dim=2) < 0.01) & (legend.amax(dim=2) > 0.5)
    for rows, columns in (
        (slice(0, 40), slice(80, 120)),
        (slice(80, 120), slice(160, 200)),
        (slice(160, 200), slice(80, 120)),
    ):
        assert grey[rows, columns].any()  # 90 above, 0 at the right, 270 below
    assert grey[80:120, :40].any()
    assert np.array_equal(legend, phase_legend(FOUR, 200))


@given(st.integers(24, 300))
def test_the_legends_ring_is_round_and_large_enough_whatever_its_side(side: int) -> None:
    legend = phase_legend(FOUR, side)
    coloured = legend.max(axis=2) - legend.min(axis=2) > 0.5
    rows, columns = (np.flatnonzero(coloured.any(axis=axis)) for axis in (1, 0))
    across = rows[-1] - rows[0] + 1
    assert across == columns[-1] - columns[0] + 1 >= min(side, LEAST_RING) - 4
    assert np.array_equal(coloured, coloured[:, ::-1]) and np.array_equal(coloured, coloured[::-1])


def test_the_pages_wheel_has_the_same_sectors_in_the_browsers_sense() -> None:
    css = gradient(FOUR)
    assert css.startswith("conic-gradient(from 0.25turn, #ffff00 0.00000turn 0.25000turn, #0000ff")
    assert css.endswith("#ff0000 0.75000turn 1.00000turn)")
