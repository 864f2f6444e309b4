"""The histogram and the axis of the field that indexes a table: the voxels that each of its 256 entries colours."""

import math
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tolerances import ROUNDING
from volsplat.client.ui.tables.field_histograms import field_histogram
from volsplat.client.volume.field_axis import field_axis
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, Field
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.rules.index_rules import Survey, grid_index_bytes

DIMS = (30, 256, 1000)
WITHOUT = [field for field in Field if field not in (Field.DENSITY, Field.STRENGTH)]


def volume_of(
    counts: list[int],
    strengths: list[int],
    low: float = -1000.0,
    high: float = 3000.0,
    second_scalar: tuple[float, float] | None = None,
) -> SurveyedVolume:
    voxels = sum(counts)
    return SurveyedVolume(
        description=VolumeDescription(
            name="a.nrrd",
            format="NRRD",
            geometry=Geometry(dims=DIMS),
            scalar_type="int16",
            unit="mm",
            second_scalar=second_scalar,
        ),
        survey=Survey(low=low, high=high, max_gradient=500.0, voxels=voxels, no_data=0),
        density_counts=counts,
        strength_counts=strengths,
        extremes=BlockExtremes.nothing(DIMS),
    )


some_counts = st.lists(st.integers(0, 10**9), min_size=300, max_size=300).filter(any)
automatic: st.SearchStrategy[Literal["auto"]] = st.just("auto")
windows = automatic | st.tuples(st.floats(-2000, 2000), st.floats(1e-3, 4000)).map(lambda two: (two[0], sum(two)))


@given(counts=some_counts, window=windows)
def test_density_is_counted_by_its_bytes_under_the_scenes_window(
    counts: list[int], window: tuple[float, float] | Literal["auto"]
) -> None:
    volume = volume_of(counts, [1])
    quantise = Quantise(window=window)
    histogram = field_histogram(volume, Field.DENSITY, quantise)
    rules = volume.quantisation(quantise)
    expected = [0] * TABLE_ENTRIES
    for n, count in enumerate(counts):
        value = -1000.0 + (n + 0.5) * (4000.0 / len(counts))
        expected[math.floor(min(max((value - rules.window[0]) * rules.density_scale, 0), 255) + 0.5)] += count
    assert histogram == tuple(expected)
    axis = field_axis(volume, Field.DENSITY, quantise)
    assert (axis.low, axis.high) == rules.window
    assert axis.label == "value"


@given(counts=some_counts)
def test_gradient_strength_is_counted_under_the_one_scale_of_the_volume(counts: list[int]) -> None:
    volume = volume_of([1], counts)
    histogram = field_histogram(volume, Field.STRENGTH, Quantise())
    assert histogram is not None and len(histogram) == TABLE_ENTRIES and sum(histogram) == sum(counts)
    axis = field_axis(volume, Field.STRENGTH, Quantise())
    assert axis.low == 0.0
    # Half of a table's range on its axis is byte 127.5, whatever the scale.
    assert axis.high * volume.strength_scale == pytest.approx(255.0, rel=ROUNDING)


def test_strengths_above_the_scale_are_in_the_last_entry() -> None:
    volume = volume_of([1], [0, 1000] + [0] * 97 + [3])
    histogram = field_histogram(volume, Field.STRENGTH, Quantise())
    assert histogram is not None
    assert histogram[-1] == 3
    assert sum(histogram[:-1]) == 1000


@given(counts=st.lists(st.integers(0, 10**9), min_size=510, max_size=510).filter(any))
def test_a_second_scalar_is_counted_over_the_whole_of_its_range(counts: list[int]) -> None:
    volume = volume_of([1], counts, second_scalar=(-180.0, 180.0))
    rules = volume.quantisation(Quantise())
    assert (rules.strength_of_byte(0), rules.strength_of_byte(255)) == (-180.0, 180.0)
    expected = [0] * TABLE_ENTRIES
    for n, count in enumerate(counts):
        expected[(n + 1) // 2] += count  # half a byte wide each
    assert field_histogram(volume, Field.STRENGTH, Quantise()) == tuple(expected)
    axis = field_axis(volume, Field.STRENGTH, Quantise())
    assert (axis.low, axis.high) == (-180.0, 180.0)


def test_a_volume_without_gradients_still_has_an_axis() -> None:
    constant = SurveyedVolume(
        description=volume_of([1], [1]).description,
        survey=Survey(low=5.0, high=5.0, max_gradient=0.0, voxels=9, no_data=0),
        density_counts=[9],
        strength_counts=[9],
        extremes=BlockExtremes.nothing(DIMS),
    )
    assert field_histogram(constant, Field.STRENGTH, Quantise()) == (9,) + (0,) * 255
    axis = field_axis(constant, Field.STRENGTH, Quantise())
    assert axis.low < axis.high


@pytest.mark.parametrize("field", WITHOUT)
def test_directions_and_places_have_no_histogram_but_an_axis(field: Field) -> None:
    volume = volume_of([1], [1])
    assert field_histogram(volume, field, Quantise()) is None
    axis = field_axis(volume, field, Quantise())
    assert axis.low < axis.high and axis.label


@pytest.mark.parametrize("axis, size", list(enumerate(DIMS)))
def test_a_grid_axis_reads_as_grid_indices(axis: int, size: int) -> None:
    grid = field_axis(volume_of([1], [1]), [Field.GRID_I, Field.GRID_J, Field.GRID_K][axis], Quantise())
    for index, byte in enumerate(grid_index_bytes(size)):
        shown = grid.low + (grid.high - grid.low) * byte / 255
        assert index - max(1, size / TABLE_ENTRIES) <= shown <= index + ROUNDING
