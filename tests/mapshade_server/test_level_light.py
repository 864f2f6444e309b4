"""How bright levels are made by what is seen in their columns, against the reference, and by themselves."""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
import torch
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from torch import Tensor

from reference import level_columns
from support.scenes.arbitrary import geometries
from support.scenes.level_packets import as_packets, drawn_packets
from support.thoroughness import examples
from volsplat.mapshade_server.frames.level_light import (
    GREATEST_FACTOR,
    LEAST_FACTOR,
    LIGHT_STEP,
    LIGHT_STEPS,
    ROUNDED_TO,
    Look,
    SeenLevel,
    depths,
    eye_along_axes,
    factor,
    reflected_in_steps,
)
from volsplat.mapshade_server.held.level_columns import AXES, DIRECTIONS, LevelColumns, Rows, Slant, columns_of
from volsplat.mapshade_server.prepare.layout import halved_geometry
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices

EXACT = 1e-9
HALF_A_STEP = 0.51 / ROUNDED_TO  # half a step of what multiplies a level's light


def test_thin_layers_are_as_deep_as_they_are_thick() -> None:
    thin = np.array([0.0, 1e-6])
    assert depths(thin, 1.0, 0.25) == pytest.approx(thin, rel=1e-3)
    assert depths(thin, 4.0, 1.0) == pytest.approx(4 * thin, rel=1e-3)
    assert depths(np.array([0.5]), 1.0, 0.25)[0] > 0.5


def by_direction(rows: Rows, dims: Index) -> list[Rows]:
    return [rows[columns.begin : columns.end] for columns in columns_of(dims)]


def level_of_one_kind(
    finer_packet: int, coarser_packet: int, spacing: matrices.Vector = (1.0, 1.0, 1.0)
) -> LevelColumns:
    """Of spacings like these."""
    i, j, k = spacing
    volume, level = (
        Geometry((n, n, n), ((f * i, 0.0, 0.0), (0.0, f * j, 0.0), (0.0, 0.0, f * k))) for n, f in ((8, 1), (4, 2))
    )
    rows = np.full((columns_of(level.dims)[-1].end, 9), finer_packet, np.uint32)
    rows[:, 0] = coarser_packet
    return LevelColumns(volume, volume, level, by_direction(rows, level.dims))


@pytest.mark.parametrize("eye", [(0.0, 0.0, 1.0), (0.6, 0.0, -0.8), (-0.48, 0.64, 0.6)])
def test_what_is_emitted_and_reflected_is_made_up_for_apart(eye: matrices.Vector) -> None:
    columns = level_of_one_kind(5 << 16, 7 << 16)
    opacity, reflected = np.full(65536, 0.001), np.full((65536, LIGHT_STEPS), 0.5)
    finer, coarser = (Look(opacity, np.full(65536, emitted), reflected) for emitted in (0.6, 0.5))
    seen = SeenLevel(columns, finer, coarser)
    assert seen.emission(eye) == seen.emission(None) == pytest.approx(1.2, abs=0.002)
    light, other_light = np.zeros((2, 32768))
    light[5], other_light[7] = 0.9, 1.0
    assert seen.light(eye, light, other_light) == pytest.approx(0.9, abs=0.002)


NO_SLANT = Slant()


class AnyLevel(NamedTuple):
    seen: SeenLevel
    columns: LevelColumns
    rows: Tensor
    looks: list[Look]  # of the volume and of the level
    dims: Index

    def by_reference(
        self, number: int, from_high: bool, slant: Slant = NO_SLANT
    ) -> tuple[float, float, Tensor, Tensor]:
        """Emitted and reflected, as the reference sees all columns in a direction."""
        columns = columns_of(self.dims)[number]
        axes = [axis for axis, along in enumerate(columns.direction) if along]
        lengths = (1.0, 1.0) if len(axes) == 1 else (2.0 / math.sqrt(len(axes)), 1.0 / math.sqrt(len(axes)))
        tables = [
            torch.from_numpy(np.column_stack((length * depths(look.opacity, thickness, thickness**2 / 4), *look[1:])))
            for look, thickness, length in zip(self.looks, (1.0, 2.0), lengths, strict=True)
        ]
        rows = self.rows[columns.begin : columns.end].tensor_split(columns.ends[:-1].tolist())
        axis = axes[0] if len(axes) == 1 else None
        look = partial(level_columns.seen, axis=axis, from_high=from_high, high_first=slant)
        seen = [look(column, finer=tables[0], coarser=tables[1]) for column in rows]
        of_finer, of_coarser, *reflected = zip(*seen, strict=True)
        return math.fsum(of_finer), math.fsum(of_coarser), sum(reflected[0]), sum(reflected[1])


def any_level(seed: int) -> AnyLevel:
    volume, random = Geometry((4, 4, 4)), torch.Generator().manual_seed(seed)
    level = halved_geometry(volume)
    rows = drawn_packets((columns_of(level.dims)[-1].end, 9), seed)
    numbers = [torch.rand((65536, 6), dtype=torch.float64, generator=random).numpy() for _ in range(2)]
    looks = [Look(table[:, 0], table[:, 1], table[:, 2:]) for table in numbers]
    columns = LevelColumns(volume, volume, level, by_direction(as_packets(rows), level.dims))
    return AnyLevel(SeenLevel(columns, looks[0], looks[1]), columns, rows, looks, level.dims)


def towards(number: int, from_high: bool, slant: Slant = NO_SLANT) -> matrices.Vector:
    """The eye at an end of a direction's columns, along an axis a little to these sides."""
    aside = iter([1e-8 if high else -1e-8 for high in slant])
    along_axis, sign = number < len(AXES), 1.0 if from_high else -1.0
    i, j, k = (next(aside) if along_axis and not along else sign * along for along in DIRECTIONS[number])
    return matrices.normalised((i, j, k))


NUMBERS = st.integers(0, len(DIRECTIONS) - 1)
SLANTS = st.builds(Slant, st.booleans(), st.booleans())


@settings(max_examples=examples(20))
@given(seed=st.integers(0, 1000), number=NUMBERS, from_high=st.booleans())
def test_in_each_direction_a_level_emits_what_the_reference_sees_of_the_one_before(
    seed: int, number: int, from_high: bool
) -> None:
    level = any_level(seed)
    ends = [level.by_reference(number, end)[:2] for end in (False, True)]
    finer, coarser = (math.fsum(each) for each in zip(*ends, strict=True))
    assert level.seen.emission(towards(number, from_high)) == factor(finer, coarser)


@settings(max_examples=examples(20))
@given(seed=st.integers(0, 1000), number=NUMBERS, from_high=st.booleans(), slant=SLANTS)
def test_in_each_direction_a_level_reflects_what_the_reference_sees_of_the_one_before(
    seed: int, number: int, from_high: bool, slant: Slant
) -> None:
    level, random = any_level(seed), torch.Generator().manual_seed(seed)
    light, level_light = 0.5 + torch.rand((2, 32768), dtype=torch.float64, generator=random)
    _, _, of_finer, of_coarser = level.by_reference(number, from_high, slant)
    light *= level_columns.lit(of_coarser, level_light) / level_columns.lit(of_finer, light)
    expected = level_columns.lit(of_finer, light)
    found = level.seen.light(towards(number, from_high, slant), light.numpy(), level_light.numpy())
    less, more = (
        level_columns.lit(of_coarser, factor * level_light) for factor in (found - HALF_A_STEP, found + HALF_A_STEP)
    )
    assert less < expected or found == LEAST_FACTOR
    assert expected < more or found == GREATEST_FACTOR


@given(
    spacing=st.tuples(*[st.floats(0.5, 2.0)] * 3),
    eye=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda eye: math.hypot(*eye) > 0.1),
)
def test_a_ray_crosses_as_many_voxels_as_the_columns_that_it_is_made_of(
    spacing: matrices.Vector, eye: matrices.Vector
) -> None:
    columns = level_of_one_kind(0, 0, spacing)
    sides = columns.sides(eye)
    assert 1 <= len(sides) <= 3 and all(side.share > 0.0 for side in sides)
    counts = columns_of((4, 4, 4))
    crossed = np.zeros(3)
    for number, _, from_high, share in sides:
        part = share * counts[number].number / counts[number].every
        crossed += part * np.array(DIRECTIONS[number]) * (1 if from_high else -1)
    expected = np.array(eye) / np.array(spacing) * matrices.cube_root(math.prod(spacing))
    assert crossed == pytest.approx(expected, abs=1e-9)


def test_a_light_that_voxels_have_no_room_for_counts_as_much_as_they_have() -> None:
    columns = level_of_one_kind(5 << 16, 7 << 16)
    bright, dim = np.full((2, 32768), [[0.8], [0.9]])
    for room, seen_of_bright in ((0.5, 0.5), (2.0, 0.8)):
        finer, coarser = (
            Look(
                np.full(65536, 0.001),
                np.zeros(65536),
                reflected_in_steps(*np.full((2, 65536, 3), [[[refl]], [[room]]])),
            )
            for refl, room in ((1.0, room), (0.5, 2.0))
        )
        expected = seen_of_bright / (0.5 * 0.9)
        found = SeenLevel(columns, finer, coarser).light((0.0, 0.0, 1.0), bright, dim)
        assert found == pytest.approx(min(expected, GREATEST_FACTOR), abs=2 * HALF_A_STEP)


@given(refl=st.floats(0.0, 1.0), emitted=st.floats(0.0, 1.0), light=st.integers(0, 4))
def test_by_whole_steps_of_light_voxels_reflect_what_they_have_room_for(
    refl: float, emitted: float, light: int
) -> None:
    steps = reflected_in_steps(np.full((1, 3), refl), np.full((1, 3), 1.0 - emitted))
    whole = [LIGHT_STEP * float(steps[0, :n].sum()) for n in range(LIGHT_STEPS + 1)]
    assert whole == sorted(whole)
    assert whole[light] <= min(refl * light * LIGHT_STEP, 1.0 - emitted) + EXACT
    assert whole[-1] == pytest.approx(min(refl * LIGHT_STEPS * LIGHT_STEP, 1.0 - emitted), abs=EXACT)


@settings(max_examples=examples(20))
@given(seed=st.integers(0, 1000), turn=st.floats(0.0, 6.0), rise=st.floats(-1.5, 1.5))
def test_between_directions_a_level_emits_between_what_it_does_in_each(seed: int, turn: float, rise: float) -> None:
    level = any_level(seed)
    eye = (math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise))
    sides = level.columns.sides(eye)
    of_sides = [level.seen.emission(towards(side.number, side.from_high, side.slant)) for side in sides]
    assert min(of_sides) <= level.seen.emission(eye) <= max(of_sides)


def test_of_nothing_there_is_nothing_to_make_up_for() -> None:
    assert factor(0.0, 0.5) == factor(0.5, 0.0) == 1.0
    assert factor(9.0, 1.0) == 2.0 and factor(1.0, 9.0) == 0.5


def test_sums_in_another_order_give_the_same_factor() -> None:
    assert factor(1.0 + 1e-13, 1.5) == factor(1.0, 1.5) == round(1024 / 1.5) / 1024


@given(geometry=geometries(), angles=st.tuples(st.floats(0.0, 6.0), st.floats(-1.5, 1.5)))
def test_the_eye_is_found_from_the_light(geometry: Geometry, angles: tuple[float, float]) -> None:
    turn, rise = angles
    eye = (math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise))
    light = matrices.normalised((0.3, -0.5, 0.8))
    half_way = matrices.normalised(matrices.plus(light, eye))
    found = eye_along_axes(light, half_way, geometry)
    for axis in range(3):
        along = matrices.normalised(matrices.column(geometry.index_to_physical, axis))
        assert found[axis] == pytest.approx(matrices.dot(along, eye), abs=1e-6)
    assert eye_along_axes(light, (0.0, 0.0, 0.0), Geometry((4, 4, 4))) == pytest.approx([-n for n in light])


@given(eye=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda eye: math.hypot(*eye) > 0.1))
@example(eye=(1e-17, -1.0, -1e-17))
@example(eye=(-0.6, 0.0, 0.8))
def test_of_voxels_abreast_the_nearer_come_first(eye: matrices.Vector) -> None:
    """Those of which neither is come from the upper end, as samples do."""
    *_, middle, most = sorted(map(abs, eye))
    assume(most > middle)
    axis = max(range(3), key=lambda axis: abs(eye[axis]))
    assume(all(abs(towards) < 1e-11 or abs(towards) > 1e-9 for towards in eye))
    first, second = (towards > -1e-10 for along, towards in enumerate(eye) if along != axis)
    (side,) = (side for side in level_of_one_kind(0, 0).sides(eye) if side.number < len(AXES))
    assert (side.number, side.slant) == (axis, (first, second))


def test_rows_of_another_level_are_refused() -> None:
    volume = Geometry((8, 8, 8))
    with pytest.raises(ValueError, match=r"64 voxels in columns have no rows of shape \(5, 9\)"):
        LevelColumns(volume, volume, halved_geometry(volume), [np.zeros((5, 9), np.uint32)])
