"""A fit fills the image with what is visible, from whichever side, and cuts nothing off; of what turns it is steady."""

from pathlib import Path

import msgspec
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from support.scenes.arbitrary import geometries, plain_scene
from support.thoroughness import examples
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.surveyed_volume import asking_for_fit
from volsplat.client.volume.visible_part import extent_from, extent_in_a_turn, fitting_view, visible_points
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.scene import Bounds, Scene, View
from volsplat.protocol.description.shading_tables import CrossBar, Field
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.index_rules import Quantisation

SIZE = 96
DIMS = (60, 70, 80)
CENTRE, RADIUS = (17.0, 50.0, 30.0), 13.0
VISIBLE = 0.005


def ball_in(folder: Path, stray: bool) -> Path:
    """A ball in a corner of the grid, and perhaps one stray voxel far from it."""
    k, j, i = torch.meshgrid(*(torch.arange(n) for n in reversed(DIMS)), indexing="ij")
    inside = (i - CENTRE[0]) ** 2 + (j - CENTRE[1]) ** 2 + (k - CENTRE[2]) ** 2 <= RADIUS**2
    values = (200 * inside).to(torch.uint8)
    values[75, 5, 55] = 200 * stray
    path = folder / "ball.nrrd"
    write_volume(path, values, Geometry(DIMS))
    return path


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ball_in(tmp_path_factory.mktemp("fit"), stray=True)


@pytest.fixture(scope="module")
def lone_ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without the stray voxel, which a fit does not keep off the rim."""
    return ball_in(tmp_path_factory.mktemp("fit"), stray=False)


def scene_from(rotation: tuple[float, float, float, float], **view: object) -> Scene:
    return plain_scene(size=(SIZE, SIZE), view=View(rotation=rotation, **view))  # type: ignore[arg-type]


@settings(max_examples=examples(15))
@given(azimuth=st.floats(-180, 180), elevation=st.floats(-90, 90))
def test_from_any_side_a_fit_fills_the_image_and_cuts_nothing(
    lone_ball: Path, azimuth: float, elevation: float
) -> None:
    with SingleProcess(lone_ball) as single:
        scene = scene_from(rotation_from_angles(azimuth, elevation))
        alpha = single.render(scene)[..., 3]
    rim = torch.cat((alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]))
    assert rim.max() == 0
    seen = (alpha > VISIBLE).nonzero()
    height, width = (seen.max(dim=0).values - seen.min(dim=0).values + 1).tolist()
    assert min(height, width) >= 0.75 * SIZE


@pytest.fixture(scope="module")
def rod(tmp_path_factory: pytest.TempPathFactory) -> Path:
    values = torch.zeros((16, 16, 96), dtype=torch.uint8)
    values[3:13, 3:13, 3:93] = 200
    path = tmp_path_factory.mktemp("fit") / "rod.nrrd"
    write_volume(path, values, Geometry((96, 16, 16)))
    return path


@settings(max_examples=examples(15))
@given(azimuth=st.floats(-180, 180), elevation=st.floats(-90, 90), height=st.sampled_from([SIZE // 2, SIZE]))
def test_a_still_is_filled_by_whatever_outline_it_shows(
    rod: Path, azimuth: float, elevation: float, height: int
) -> None:
    with SingleProcess(rod) as single:
        scene = scene_from(rotation_from_angles(azimuth, elevation)).with_(size=(SIZE, height))
        alpha = single.render(scene)[..., 3]
    rim = torch.cat((alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]))
    assert rim.max() == 0
    seen = (alpha > VISIBLE).nonzero()
    sides = seen.max(dim=0).values - seen.min(dim=0).values + 1
    assert max(sides[0] / height, sides[1] / SIZE) >= 0.8


def test_one_fit_holds_for_all_rotations_partitions_and_steps_of_a_hand(ball: Path) -> None:
    scenes = [scene_from(rotation_from_angles(azimuth, 20)) for azimuth in (0, 50)]
    with SingleProcess(ball) as single, Session(ball, workers=3) as session:
        volumes = (single.volume, session.volume)
        views = [volume.fitted_to_turn(scene).view for volume in volumes for scene in scenes]
        assert len({(view.zoom, view.center) for view in views}) == 1
        assert views[0].center == pytest.approx(CENTRE, abs=1.5)
        assert torch.equal(single.render(scenes[1]), session.render(scenes[1]))
        settled = single.volume.settled(scenes[0])
        assert single.volume.settled(settled) == single.volume.fitted_to_turn(settled) == settled
        assert asking_for_fit(settled).view.zoom == "fit"


def test_bounds_tables_and_cross_bar_decide_what_is_fitted(ball: Path) -> None:
    scene = scene_from((0.0, 0.0, 0.0, 1.0))
    with SingleProcess(ball) as single:
        whole = single.volume.settled(scene).view
        cut = msgspec.structs.replace(scene, bounds=Bounds(low=(0, 0, 37)))
        half = single.volume.settled(cut).view
        assert half.center[2] > whole.center[2] and half.zoom > whole.zoom  # type: ignore[operator]
        by_strength = msgspec.structs.replace(scene, cross_bar=CrossBar(opac=Field.STRENGTH))
        everything = single.volume.settled(by_strength).view
        assert everything.center == pytest.approx([(n - 1) / 2 for n in DIMS])
        assert everything.zoom < whole.zoom  # type: ignore[operator]
        edged = msgspec.structs.replace(scene, image=msgspec.structs.replace(scene.image, edges=True))
        assert single.volume.settled(edged).view.zoom < whole.zoom  # type: ignore[operator]
        clear = msgspec.structs.replace(scene.tables.opac, points=((0.0, 0.0),))
        nothing = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=clear))
        assert single.volume.settled(nothing).view.zoom == everything.zoom


@settings(max_examples=examples(30))
@given(
    geometry=geometries(), origin=st.tuples(*[st.floats(-1e15, 1e15)] * 3), centred=st.booleans(), edges=st.booleans()
)
def test_a_fit_does_not_depend_on_where_the_volume_lies(
    geometry: Geometry, origin: tuple[float, float, float], centred: bool, edges: bool
) -> None:
    scene = scene_from((0.0, 0.0, 0.0, 1.0), center="middle" if centred else (1.0, 0.5, 0.0))
    scene = msgspec.structs.replace(scene, image=msgspec.structs.replace(scene.image, edges=edges))
    quantisation, extremes = Quantisation((0.0, 255.0), 1.0), BlockExtremes.nothing(geometry.dims)
    for extent_of in (extent_from, extent_in_a_turn):
        views = []
        for at in ((0.0, 0.0, 0.0), origin):
            placed = msgspec.structs.replace(geometry, origin=at)
            points = visible_points(scene, placed, quantisation, extremes)
            views.append(fitting_view(scene, placed, extent_of(scene.view, placed, points)))
        assert views[0] == views[1]


def fit_beside(folder: Path, low: tuple[int, int, int], high: tuple[int, int, int], value: int) -> View:
    """Of a ball in a grid's middle, and a box of this value beside it, in a scene whose opacity rises with it."""
    k, j, i = torch.meshgrid(*(torch.arange(96) for _ in range(3)), indexing="ij")
    values = (200 * ((i - 48) ** 2 + (j - 48) ** 2 + (k - 48) ** 2 <= 25**2)).to(torch.uint8)
    (i0, j0, k0), (i1, j1, k1) = low, high
    values[k0:k1, j0:j1, i0:i1] = value
    write_volume(folder / "beside.nrrd", values, Geometry((96, 96, 96)))
    with SingleProcess(folder / "beside.nrrd") as single:
        scene = scene_from((0.0, 0.0, 0.0, 1.0)).with_(opac=[(0.0, 0.0), (1.0, 1.0)])
        return single.volume.settled(scene).view


FAINT_VALUE, SOLID_VALUE = 20, 200


@pytest.mark.parametrize("solid", [False, True])
def test_a_faint_sheet_beside_what_is_solid_does_not_count_and_a_solid_one_does(tmp_path: Path, solid: bool) -> None:
    alone = fit_beside(tmp_path, (0, 0, 0), (0, 0, 0), 0)
    sheet = fit_beside(tmp_path, (40, 88, 40), (90, 91, 60), SOLID_VALUE if solid else FAINT_VALUE)
    assert (sheet == alone) == (not solid)


def test_a_faint_cloud_beside_what_is_solid_counts(tmp_path: Path) -> None:
    alone = fit_beside(tmp_path, (0, 0, 0), (0, 0, 0), 0)
    cloud = fit_beside(tmp_path, (40, 75, 40), (90, 95, 60), FAINT_VALUE)
    assert cloud.center[1] > alone.center[1] and cloud.zoom < alone.zoom  # type: ignore[operator]


def test_what_is_fitted_has_the_images_middle_from_each_side(shared_data: Path) -> None:
    with SingleProcess(shared_data / "ct_head/ct_head_96x128x113.nrrd") as single:
        scene = single.volume.default_scene().with_(size=SIZE)
        for side in ("front", "left", "top"):
            alpha = single.render(scene.with_(rotation=side))[..., 3]
            seen = (alpha > 0.1).nonzero()
            ends = seen.min(dim=0).values, SIZE - 1 - seen.max(dim=0).values
            assert (ends[0] - ends[1]).abs().max() <= 0.1 * SIZE


@pytest.mark.parametrize("turns", [False, True])
def test_what_is_given_keeps_its_meaning(ball: Path, turns: bool) -> None:
    with SingleProcess(ball) as single:
        fit = single.volume.fitted_to_turn if turns else single.volume.settled
        zoomed = fit(scene_from((0.0, 0.0, 0.0, 1.0), zoom=2.0)).view
        assert (zoomed.zoom, zoomed.center) == (2.0, "middle")
        placed = fit(scene_from((0.0, 0.0, 0.0, 1.0), center=(17.0, 50.0, 30.0))).view
        assert placed.center == pytest.approx((17.0, 50.0, 30.0))
        aside = fit(scene_from((0.0, 0.0, 0.0, 1.0), center=(30.0, 50.0, 30.0))).view
        assert aside.zoom < placed.zoom  # type: ignore[operator]


def test_the_real_head_fills_its_image(shared_data: Path) -> None:
    with SingleProcess(shared_data / "ct_head/ct_head_96x128x113.nrrd") as single:
        rows = (single.render(single.volume.default_scene())[..., 3] > 0.02).any(dim=1).nonzero()
    assert rows.max() - rows.min() + 1 >= 0.9 * 512
