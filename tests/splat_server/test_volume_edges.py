"""The white edges: which lie in front, how they are attenuated, and how they are drawn."""

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from support.scenes.arbitrary import index_to_physical, plain_scene, quaternions
from support.scenes.owned import Drawing, batch_of, owners, wait_until_complete
from support.scenes.row_runs import Dot, Run
from tolerances import EDGE_ANGLE, SPLAT_FLOAT32
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Image, Order, Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, grid_on_screen
from volsplat.protocol.rules.packet_layout import OPACITY_CODES, opacity_of_code
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.rules.volume_edges import CLIP_LINE_WIDTH, VOLUME_LINE_WIDTH, volume_edges
from volsplat.splat_server._kernels import Bell, EdgeLayer, ReadBudget
from volsplat.splat_server.edge_layers import edge_layers
from volsplat.splat_server.frame_assembly import FrameAssembly

SIZE = 40
DIMS = (10, 10, 10)


def scene_of(rotation: tuple[float, float, float, float], bounds: Bounds | None = None, zoom: float = 1.5) -> Scene:
    scene = plain_scene(view=View(rotation=rotation, zoom=zoom), bounds=bounds, order=Order.BACK_TO_FRONT)
    return msgspec.structs.replace(scene, image=Image(width=SIZE, height=SIZE, edges=True))


def coverage(layer: EdgeLayer, width: int = SIZE, height: int = SIZE) -> Tensor:
    """(H, W) of one layer, seen through an empty image."""
    with owners() as made:
        empty = Drawing.begun(made, (width, height), None, edges=(layer, EdgeLayer(width, height)))
        return empty.pixels()[..., 3]


TURNED = (0.2, 0.3, 0.1, 0.9)


def test_there_are_twelve_edges_and_twelve_more_with_bounds() -> None:
    scene, geometry = scene_of(TURNED), Geometry(DIMS)
    assert len(volume_edges(scene, geometry)) == 12
    cut = scene_of(TURNED, Bounds(low=(1, 2, 3), high=(5, -1, 7)))
    edges = volume_edges(cut, geometry)
    assert [edge.line_width for edge in edges] == [VOLUME_LINE_WIDTH] * 12 + [CLIP_LINE_WIDTH] * 12
    off = msgspec.structs.replace(scene, image=Image(width=SIZE, height=SIZE, edges=False))
    assert volume_edges(off, geometry) == ()


@given(index_to_physical(), quaternions)
def test_an_edge_is_behind_when_both_its_faces_face_away(
    matrix: Matrix, rotation: tuple[float, float, float, float]
) -> None:
    """By the depth of each face's plane: nine edges are in front and three behind, those that meet in one corner."""
    scene, geometry = scene_of(rotation), Geometry((3, 4, 5), matrix)
    grid = grid_on_screen(scene, geometry)
    edges = volume_edges(scene, geometry)
    facing = [abs(row[2]) for row in matrices.inverse(grid.pixels_per_index)]
    behind = [edge for edge in edges if not edge.in_front]
    if min(facing) / max(facing) < EDGE_ANGLE:  # a face seen edge on
        assert len(behind) <= 3
        return
    assert len(behind) == 3
    # A ray through the box ends where the three planes that face away meet: at the corner farthest along each
    # axis in the direction away from the viewer.
    away = [row[2] < 0 for row in matrices.inverse(grid.pixels_per_index)]
    doubled = [2 * n - 1 if upper else -1 for n, upper in zip(geometry.dims, away, strict=True)]
    corner = tuple(dda.at_half_indices((doubled[0], doubled[1], doubled[2])) / FIXED_ONE for dda in (grid.x, grid.y))
    assert all(corner in (edge.begin, edge.end) for edge in behind)


@pytest.mark.parametrize("opacity", [OPACITY_CODES - 1, OPACITY_CODES - 300])
def test_lines_behind_are_attenuated_and_lines_in_front_are_not(opacity: int) -> None:
    scene, geometry = scene_of(TURNED, zoom=0.25), Geometry((100, 100, 100))
    runs = [Run(0, n, 0, tuple(Dot(x * 64, n * 64, opacity, (0, 0, 0)) for x in range(SIZE))) for n in range(SIZE)]
    plan = plan_frame(scene, geometry, Step.C)
    with owners() as made:
        news = Bell()
        assembly = FrameAssembly(made, plan, 1)
        assembly.begin([Region(1, 0, plan.height)], 1, news)
        assembly.splat.push(0, batch_of(runs, ReadBudget(1, news)), 0, SIZE, True)
        wait_until_complete(assembly.splat, news)
        image = torch.frombuffer(bytearray(assembly.published()), dtype=torch.float32).reshape(SIZE, SIZE, 4)
    front, back = edge_layers(volume_edges(scene, geometry), SIZE, SIZE)
    before, behind = coverage(front)[..., None], coverage(back)[..., None]
    a = opacity_of_code(opacity)
    black = torch.tensor([0.0, 0.0, 0.0, a])
    expected = before + (1 - before) * (black + (1 - a) * behind)
    assert before.max() == 1 and behind.max() == 1
    assert (image - expected).abs().max() <= SPLAT_FLOAT32


def test_a_line_is_as_wide_as_it_says_and_smooth_at_its_sides() -> None:
    for width in (VOLUME_LINE_WIDTH, CLIP_LINE_WIDTH):
        layer = EdgeLayer(SIZE, SIZE)
        layer.draw(-10.0, 20.25, 50.0, 20.25, width)
        covered = coverage(layer)
        assert torch.equal(covered, covered[:, :1].expand(SIZE, SIZE))
        assert float(covered[:, 0].sum()) == pytest.approx(width, abs=SPLAT_FLOAT32)
        assert set((covered[:, 0] > 0).nonzero().flatten().tolist()) <= {19, 20, 21}


def test_where_lines_cross_the_greater_coverage_counts() -> None:
    one, other, both = EdgeLayer(SIZE, SIZE), EdgeLayer(SIZE, SIZE), EdgeLayer(SIZE, SIZE)
    first, second = (3.3, 4.4, 33.3, 20.2, 1.5), (30.0, 2.2, 4.4, 38.1, 1.5)
    for layer, lines in ((one, [first]), (other, [second]), (both, [first, second])):
        for line in lines:
            layer.draw(*line)
    assert torch.equal(coverage(both), torch.maximum(coverage(one), coverage(other)))


@given(st.tuples(*[st.floats(-1e9, 1e9)] * 4), st.floats(0.5, 3.0))
def test_lines_that_reach_anywhere_stay_within_the_layer(ends: tuple[float, float, float, float], width: float) -> None:
    layer = EdgeLayer(7, 5)
    layer.draw(*ends, width)
    covered = coverage(layer, 7, 5)
    assert covered.min() >= 0 and covered.max() <= 1


def test_a_far_line_through_the_image_is_drawn_where_it_passes() -> None:
    near, far = EdgeLayer(SIZE, SIZE), EdgeLayer(SIZE, SIZE)
    near.draw(-60.0, -40.0, 60.0, 80.0, 1.5)
    far.draw(-1e6 - 60.0, -1e6 - 40.0, 1e6 + 60.0, 1e6 + 80.0, 1.5)
    assert (coverage(near) - coverage(far)).abs().max() <= SPLAT_FLOAT32
    assert coverage(near).max() == 1
