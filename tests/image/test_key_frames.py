"""The scenes of a movie: a turn comes round, keys are passed, and what lies between them lies between them."""

import math
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from support.scenes.arbitrary import bounds_within, geometries, plain_scene, quaternions, views
from support.scenes.scenes import colour_tables, scalar_tables
from tolerances import ROTATION_ENTRY, ROUNDING
from volsplat.client.command.render_options import SceneOptions
from volsplat.client.movie.key_frames import TurningAxis, key_framed, rotation_between, turntable
from volsplat.client.movie.table_windows import in_window
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Light, Quantise, Reconstruction, Scene, View
from volsplat.protocol.description.shading_tables import ScalarTable, Tables
from volsplat.protocol.description.table_points import interpolated
from volsplat.protocol.description.view_rotation import Quaternion, rotation_from_angles
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.resolved_view import resolved_center, resolved_zoom
from volsplat.protocol.text.errors import BadInput

GRID = Geometry((10, 20, 30))
PARTS = st.floats(0, 1)
axes: st.SearchStrategy[TurningAxis] = st.sampled_from(get_args(TurningAxis))


def entries(rotation: Quaternion) -> tuple[float, ...]:
    m: Matrix = matrices.rotation_from_quaternion(rotation)
    return (*m[0], *m[1], *m[2])


def length(q: Quaternion) -> float:
    return math.hypot(*q)


def seen(scene: Scene) -> object:
    """The scene but for its view."""
    return msgspec.structs.replace(scene, view=View())


@st.composite
def keys_of_a_volume(draw: st.DrawFn, count: int = 2) -> tuple[list[Scene], Geometry]:
    """Scenes that fit one volume, with tables of any number of points."""
    geometry = draw(geometries())
    keys = []
    for _ in range(count):
        view = draw(views(geometry.dims))
        tables = Tables(
            emit=draw(colour_tables()),
            refl=draw(colour_tables()),
            opac=draw(scalar_tables()),
            modu=draw(scalar_tables()),
        )
        scene = plain_scene(view=view, bounds=draw(bounds_within(geometry.dims)))
        component = st.floats(-1, 1, allow_subnormal=False)
        light = Light(direction=draw(st.tuples(component, component, component).filter(any)))
        keys.append(msgspec.structs.replace(scene, tables=tables, light=light))
    return keys, geometry


# -- once around


@given(rotation=quaternions, geometry=geometries(), axis=axes, frames=st.integers(1, 9))
def test_a_turn_begins_with_the_scene_itself_and_changes_nothing_but_its_rotation(
    rotation: Quaternion, geometry: Geometry, axis: TurningAxis, frames: int
) -> None:
    scene = plain_scene(view=View(rotation=rotation, zoom=2.0, center=(1.0, 2.0, 3.0)))
    scenes = turntable(scene, geometry, frames, axis)
    assert len(scenes) == frames and scenes[0] is scene
    for turned in scenes:
        assert seen(turned) == seen(scene)
        assert (turned.view.zoom, turned.view.center) == (2.0, (1.0, 2.0, 3.0))
    assert all(length(turned.view.rotation) == pytest.approx(1, abs=ROUNDING) for turned in scenes[1:])


@given(rotation=quaternions, geometry=geometries(), axis=axes, frames=st.integers(2, 9))
def test_a_turn_comes_round_in_even_parts(
    rotation: Quaternion, geometry: Geometry, axis: TurningAxis, frames: int
) -> None:
    """From each frame the next part of a turn leads to the next frame, and from the last to the first."""
    scenes = turntable(plain_scene(view=View(rotation=rotation)), geometry, frames, axis)
    for earlier, later in zip(scenes, [*scenes[1:], scenes[0]], strict=True):
        onward = turntable(earlier, geometry, frames, axis)[1]
        assert entries(onward.view.rotation) == pytest.approx(entries(later.view.rotation), abs=ROUNDING)


@given(rotation=quaternions, geometry=geometries(), axis=axes)
def test_the_axis_of_a_turn_stays_where_it_is_on_the_screen(
    rotation: Quaternion, geometry: Geometry, axis: TurningAxis
) -> None:
    scene = plain_scene(view=View(rotation=rotation))
    frame, _, name = axis.partition("-")

    def on_screen(turned: Scene) -> matrices.Vector:
        m = matrices.rotation_from_quaternion(turned.view.rotation)
        if frame == "grid":
            column = matrices.column(geometry.index_to_physical, "ijk".index(name))
            return matrices.applied(m, matrices.normalised(column))
        # The physical direction that the screen's axis had at first.
        first = matrices.rotation_from_quaternion(rotation)
        return matrices.applied(m, first["xyz".index(name)])

    for turned in turntable(scene, geometry, 5, axis):
        assert on_screen(turned) == pytest.approx(on_screen(scene), abs=ROUNDING)


def test_a_turn_about_the_upright_goes_the_way_of_the_azimuth() -> None:
    front = plain_scene(view=View(rotation=rotation_from_angles(0, 0)))
    for axis in ("screen-y", "grid-k"):
        quarters = turntable(front, GRID, 4, axis)
        for n, turned in enumerate(quarters):
            expected = entries(rotation_from_angles(90 * n, 0))
            assert entries(turned.view.rotation) == pytest.approx(expected, abs=ROTATION_ENTRY)


# -- from key to key


@given(keys_of_a_volume(3), st.integers(3, 12))
def test_the_ends_are_the_first_and_last_key_and_each_scene_fits_the_volume(
    keys_and_geometry: tuple[list[Scene], Geometry], frames: int
) -> None:
    keys, geometry = keys_and_geometry
    scenes = key_framed(keys, geometry, frames)
    assert len(scenes) == frames
    assert (scenes[0], scenes[-1]) == (keys[0], keys[-1])
    for scene in scenes:
        plan_frame(scene, geometry, Step.F)
        assert scene in keys or length(scene.view.rotation) == pytest.approx(1, abs=ROUNDING)


@given(keys_of_a_volume(3), st.integers(1, 4))
def test_every_key_is_passed_where_the_frames_divide_evenly(
    keys_and_geometry: tuple[list[Scene], Geometry], between: int
) -> None:
    keys, geometry = keys_and_geometry
    assert key_framed(keys, geometry, 2 * between + 1)[::between] == keys


@given(keys_of_a_volume(1), st.integers(2, 6))
def test_between_equal_keys_nothing_moves(keys_and_geometry: tuple[list[Scene], Geometry], frames: int) -> None:
    (key,), geometry = keys_and_geometry
    for scene in key_framed([key, key], geometry, frames):
        assert seen(scene) == seen(key)
        assert (scene.view.zoom, scene.view.center) == (key.view.zoom, key.view.center)
        assert entries(scene.view.rotation) == pytest.approx(entries(key.view.rotation), abs=ROUNDING)


@given(quaternions, quaternions, PARTS)
def test_a_rotation_goes_the_shortest_way_at_an_even_rate(a: Quaternion, b: Quaternion, part: float) -> None:
    between = rotation_between(a, b, part)
    assert length(between) == pytest.approx(1, abs=ROUNDING)
    whole = angle_between(a, b)
    assert whole <= math.pi + ROUNDING
    assume(whole < math.pi - 1e-3)  # at half a turn both ways are the shortest
    # An arc cosine knows an angle near 0 only to the root of its own rounding.
    assert angle_between(a, between) == pytest.approx(part * whole, abs=math.sqrt(ROUNDING))
    assert angle_between(between, b) == pytest.approx((1 - part) * whole, abs=math.sqrt(ROUNDING))


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """Of the turn from one rotation to the other: 0 to pi."""
    cosine = abs(sum(p * q for p, q in zip(a, b, strict=True))) / (length(a) * length(b))
    return 2 * math.acos(min(cosine, 1.0))


@given(quaternions, quaternions, PARTS)
def test_a_rotation_and_its_negative_are_the_same_key(a: Quaternion, b: Quaternion, part: float) -> None:
    negative = (-b[0], -b[1], -b[2], -b[3])
    assume(angle_between(a, b) < math.pi - 1e-3)
    assert entries(rotation_between(a, negative, part)) == pytest.approx(
        entries(rotation_between(a, b, part)), abs=ROUNDING
    )


def test_rotations_of_any_length_are_taken() -> None:
    assert rotation_between((1e300, 0.0, 0.0, 0.0), (1e-300, 0.0, 0.0, 0.0), 0.3) == (1.0, 0.0, 0.0, 0.0)


def test_zoom_grows_by_even_factors_from_what_fit_stands_for() -> None:
    fit = plain_scene(size=(400, 300))
    near = plain_scene(size=(400, 300), view=View(zoom=200.0, center=(0.0, 0.0, 0.0)))
    scenes = key_framed([fit, near], GRID, 5)
    zooms = [resolved_zoom(scene, GRID) for scene in scenes]
    factors = [later / earlier for earlier, later in zip(zooms, zooms[1:], strict=False)]
    assert factors == pytest.approx([factors[0]] * 4, rel=ROUNDING)
    assert zooms[-1] == 200.0
    centres = [resolved_center(scene, GRID) for scene in scenes]
    assert centres[2] == pytest.approx((2.25, 4.75, 7.25), rel=ROUNDING)


def test_where_both_keys_fit_the_volume_all_between_fits_it() -> None:
    turned = plain_scene(view=View(rotation=(0.0, 1.0, 0.0, 1.0)))
    for scene in key_framed([plain_scene(), turned], GRID, 4):
        assert (scene.view.zoom, scene.view.center) == ("fit", "middle")


def test_bounds_move_by_whole_voxels_and_know_the_end() -> None:
    whole = plain_scene()
    slice_ = plain_scene(bounds=Bounds(low=(4, 0, 10), high=(5, 20, 20)))
    scenes = key_framed([whole, slice_], GRID, 5)
    assert scenes[2].bounds == Bounds(low=(2, 0, 5), high=(8, 20, 25))


@pytest.mark.parametrize("auto_first", [True, False])
def test_a_density_that_both_keys_begin_at_is_where_all_between_begin(auto_first: bool) -> None:
    """Whichever window each of them has."""
    begin, automatic, other = 300.0, (-1000.0, 2000.0), (0.0, 1000.0)

    def key(window: tuple[float, float], auto: bool) -> Scene:
        low, high = window
        scene = plain_scene()
        opac = ScalarTable(points=((0.0, 0.0), ((begin - low) / (high - low), 0.0), (1.0, 0.8)))
        return msgspec.structs.replace(
            scene,
            tables=msgspec.structs.replace(scene.tables, opac=opac),
            quantise=Quantise(window="auto" if auto else window),
        )

    keys = [key(automatic, auto=True), key(other, auto=False)]
    for scene in key_framed(keys if auto_first else keys[::-1], GRID, 7, automatic):
        low, high = automatic if scene.quantise.window == "auto" else scene.quantise.window
        clear = max(position for position, value in scene.tables.opac.points if value == 0.0)
        assert low + clear * (high - low) == pytest.approx(begin)


@given(scalar_tables(), st.floats(-0.5, 0.9), st.floats(0.2, 2.0))
def test_a_table_under_another_window_has_the_same_for_each_density(
    table: ScalarTable, low: float, width: float
) -> None:
    scene = plain_scene()
    scene = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=table))
    moved = in_window(scene, (0.0, 1.0), (low, low + width)).tables.opac
    assert len(moved.points) == len(table.points)
    for n, value in enumerate(interpolated(list(moved.points), 101)):
        density = low + n / 100 * width
        steps = [abs(density - position) for position, _ in table.points]
        if 0 <= density <= 1 and min(steps) > 1e-6:  # not where it jumps
            expected = np.interp(density, [at for at, _ in table.points], [value for _, value in table.points])
            assert value == pytest.approx(expected, abs=1e-6)


def test_tables_of_as_many_points_blend_and_others_switch_at_the_key() -> None:
    def with_opacity(*points: tuple[float, float]) -> Scene:
        scene = plain_scene()
        tables = msgspec.structs.replace(scene.tables, opac=ScalarTable(points=points))
        return msgspec.structs.replace(scene, tables=tables)

    low, high = with_opacity((0.25, 0.0), (1.0, 0.5)), with_opacity((0.75, 0.5), (1.0, 1.0))
    assert key_framed([low, high], GRID, 3)[1].tables.opac.points == ((0.5, 0.25), (1.0, 0.75))
    single = with_opacity((0.0, 1.0))
    opacities = [scene.tables.opac for scene in key_framed([low, single], GRID, 4)]
    assert opacities == [low.tables.opac] * 3 + [single.tables.opac]


def test_all_else_is_the_earlier_keys_until_the_later_one_is_reached() -> None:
    first = plain_scene(reconstruction=Reconstruction(radius=2.0))
    second = plain_scene(reconstruction=Reconstruction(radius=3.0), opacity=0.5)
    radii = [scene.reconstruction.radius for scene in key_framed([first, second, first], GRID, 5)]
    assert radii == [2.0, 2.0, 3.0, 3.0, 2.0]


def test_light_goes_straight_whatever_its_length_and_switches_where_there_is_no_way() -> None:
    def lit(direction: matrices.Vector, fixed_to: str = "world") -> Scene:
        light = Light(direction=direction, fixed_to=fixed_to)  # type: ignore[arg-type]
        return msgspec.structs.replace(plain_scene(), light=light)

    def halfway(a: Scene, b: Scene) -> Light:
        return key_framed([a, b], GRID, 3)[1].light

    assert halfway(lit((9.0, 0.0, 0.0)), lit((0.0, 0.1, 0.0))).direction == (0.5, 0.5, 0.0)
    assert halfway(lit((1.0, 0.0, 0.0)), lit((-2.0, 0.0, 0.0))).direction == (1.0, 0.0, 0.0)
    assert halfway(lit((1.0, 0.0, 0.0)), lit((0.0, 1.0, 0.0), "grid")) == Light(direction=(1.0, 0.0, 0.0))


def test_the_depth_cue_and_silhouettes_come_little_by_little() -> None:
    first, last = plain_scene(), plain_scene()
    last = msgspec.structs.replace(last, light=msgspec.structs.replace(last.light, depth_cue=1.0, silhouettes=0.5))
    between = [(scene.light.depth_cue, scene.light.silhouettes) for scene in key_framed([first, last], GRID, 3)]
    assert between == [(0.0, 0.0), (0.5, 0.25), (1.0, 0.5)]


@pytest.mark.parametrize(("keys", "frames"), [(0, 5), (1, 5), (3, 2)])
def test_too_few_keys_or_frames_are_refused(keys: int, frames: int) -> None:
    scenes = f"{keys} key scene{'' if keys == 1 else 's'};"
    with pytest.raises(BadInput, match=f"{frames} frames cannot pass through {scenes}"):
        key_framed([plain_scene()] * keys, GRID, frames)


def test_bounds_outside_the_volume_are_refused_by_name() -> None:
    outside = plain_scene(bounds=Bounds(low=(0, 0, 40)))
    with pytest.raises(BadInput, match="bounds on k are 40..30"):
        key_framed([plain_scene(), outside], GRID, 3)


def test_a_key_file_lies_over_the_scene_and_under_the_options(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("[image]\nedges = true\nwidth = 99\n[view]\nzoom = 3.0\n")
    (tmp_path / "near.toml").write_text("[view]\nzoom = 9.0\n[image]\nwidth = 77\n")
    (tmp_path / "far.toml").write_text("")
    options = SceneOptions(tmp_path / "scene.toml", changes={"image.width": 40, "image.height": 30})
    near, far = options.key_scenes(None, [tmp_path / "near.toml", tmp_path / "far.toml"])
    assert (near.view.zoom, far.view.zoom) == (9.0, 3.0)
    assert all((key.image.width, key.image.height, key.image.edges) == (40, 30, True) for key in (near, far))
