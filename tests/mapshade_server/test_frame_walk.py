"""The walk through a frame: order, partition, limits of batches, bounds and strides, and what is left out."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from reference import mapping
from support.scenes.arbitrary import flips_and_orders, geometries, plain_scene, quaternion_to
from support.scenes.shaded_packets import all_batches, batches_of, packets_of, runs_of
from support.scenes.shadings import WINDOW, partitions, quantisations, shaded_scenes, volumes
from volsplat.mapshade_server._kernels import Batch
from volsplat.mapshade_server.frames.frame_walk import FrameWalk, sample_reach
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Image, Order, Scene, View
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.traversal import visits_of
from volsplat.protocol.text.errors import LocalProtocolError

LATTICE = 64
PLAIN = Quantisation(window=WINDOW, strength_scale=50.0)
CUBE: Index = (5, 6, 7)
WIDE = (8192, 8192)
limits = st.integers(1, 40)


def sub_cubes(geometry: Geometry, values: Tensor, quantisation: Quantisation, boxes: list[Box]) -> list[SubCube]:
    held = [SubCube.of_volume(geometry, values, box) for box in boxes]
    for sub_cube in held:
        sub_cube.pack(quantisation)
    return held


def visible_volume(geometry: Geometry) -> Tensor:
    """Values that plain_scene draws everywhere."""
    return torch.ones(geometry.dims[::-1])


def walked(geometry: Geometry, values: Tensor, scene: Scene, plan: FramePlan) -> list[Batch]:
    return all_batches(
        FrameWalk(sub_cubes(geometry, values, PLAIN, [geometry.box]), Drawing.of(scene, plan, geometry, PLAIN))
    )


@given(data=st.data(), geometry=geometries(), quantisation=quantisations(), step=st.sampled_from(PAPER_STEPS))
def test_one_server_with_many_boxes_sends_what_it_would_for_the_whole(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation, step: Step
) -> None:
    scene, values = data.draw(shaded_scenes(geometry)), data.draw(volumes(geometry))
    plan = plan_frame(scene, geometry, step)
    whole = sub_cubes(geometry, values, quantisation, [geometry.box])
    parts = sub_cubes(geometry, values, quantisation, data.draw(partitions(geometry)))
    one = all_batches(FrameWalk(whole, Drawing.of(scene, plan, geometry, quantisation)))
    many = all_batches(FrameWalk(parts, Drawing.of(scene, plan, geometry, quantisation)))
    assert packets_of(many).rows() == packets_of(one).rows()
    assert sum(batch.voxels_visited for batch in many) == sum(batch.voxels_visited for batch in one)


@given(data=st.data(), geometry=geometries(), quantisation=quantisations(), step=st.sampled_from(PAPER_STEPS))
def test_runs_of_many_servers_merge_by_key_into_what_one_server_sends(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation, step: Step
) -> None:
    scene, values = data.draw(shaded_scenes(geometry)), data.draw(volumes(geometry))
    plan = plan_frame(scene, geometry, step)
    whole = sub_cubes(geometry, values, quantisation, [geometry.box])
    expected = packets_of(all_batches(FrameWalk(whole, Drawing.of(scene, plan, geometry, quantisation)))).rows()
    runs: list[tuple[list[int], list[list[int]]]] = []
    for sub_cube in sub_cubes(geometry, values, quantisation, data.draw(partitions(geometry))):
        batches = all_batches(FrameWalk([sub_cube], Drawing.of(scene, plan, geometry, quantisation)))
        keys, counts = runs_of(batches).keys.tolist(), runs_of(batches).count.tolist()
        rows = iter(packets_of(batches).rows())
        runs += [(key, [next(rows) for _ in range(count)]) for key, count in zip(keys, counts, strict=True)]
    runs.sort(key=lambda run: run[0])
    assert [row for _, rows_of_run in runs for row in rows_of_run] == expected


@given(data=st.data(), geometry=geometries(), step=st.sampled_from(PAPER_STEPS), max_packets=limits, max_voxels=limits)
def test_limits_decide_where_batches_end_but_not_what_they_hold(
    data: st.DataObject, geometry: Geometry, step: Step, max_packets: int, max_voxels: int
) -> None:
    scene, values = data.draw(shaded_scenes(geometry)), data.draw(volumes(geometry))
    plan = plan_frame(scene, geometry, step)
    held = sub_cubes(geometry, values, PLAIN, data.draw(partitions(geometry)))
    large = all_batches(FrameWalk(held, Drawing.of(scene, plan, geometry, PLAIN)))
    small = all_batches(FrameWalk(held, Drawing.of(scene, plan, geometry, PLAIN)), max_packets, max_voxels)
    assert packets_of(small).rows() == packets_of(large).rows()
    longest_row = max(geometry.dims)
    for batch in small:
        [part] = parts_of(batch)
        assert part.packet_count < max_packets + longest_row
        assert batch.voxels_visited < max_voxels + longest_row
        assert len(part.runs) == ROW_RUN_BYTES * part.run_count
        assert len(part.packets) == SHADED_PACKET_BYTES * part.packet_count


@given(data=st.data(), geometry=geometries(), step=st.sampled_from(PAPER_STEPS), max_packets=limits, max_voxels=limits)
def test_keys_rise_and_nothing_comes_before_what_was_reached(
    data: st.DataObject, geometry: Geometry, step: Step, max_packets: int, max_voxels: int
) -> None:
    scene, values = data.draw(shaded_scenes(geometry)), data.draw(volumes(geometry))
    plan = plan_frame(scene, geometry, step)
    held = sub_cubes(geometry, values, PLAIN, data.draw(partitions(geometry)))
    batches = all_batches(FrameWalk(held, Drawing.of(scene, plan, geometry, PLAIN)), max_packets, max_voxels)
    reached, end = [0, 0], [0, 0, 0]
    for batch in batches:
        runs = runs_of([batch])
        for (sheet, row, first), count in zip(runs.keys.tolist(), runs.count.tolist(), strict=True):
            assert [sheet, row] >= reached
            assert [sheet, row, first] >= end
            assert count >= 1
            end = [sheet, row, first + count]
        assert list(batch.reached) >= reached
        reached = list(batch.reached)
        assert batch.last == (batch is batches[-1])
    assert reached == [plan.visits[plan.traversal.axes[0]].count, 0]


@given(data=st.data(), geometry=geometries(), step=st.sampled_from(PAPER_STEPS))
def test_every_sample_of_bounds_and_stride_is_visited_once(data: st.DataObject, geometry: Geometry, step: Step) -> None:
    drawn = data.draw(shaded_scenes(geometry))
    scene = plain_scene(view=drawn.view, bounds=drawn.bounds, order=drawn.order, size=WIDE)
    plan = plan_frame(scene, geometry, step)
    samples = mapping.samples_of(scene, geometry, plan)
    batches = walked(geometry, visible_volume(geometry), scene, plan)
    got = packets_of(batches)
    assert torch.equal(got.keys, samples.ordinals[:, :2])
    assert torch.equal(got.position, samples.lattice)
    assert sum(batch.voxels_visited for batch in batches) == len(samples.indices)


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize(("magnitudes", "falling"), flips_and_orders())
def test_all_48_traversals_of_a_cube_go_by_depth(
    magnitudes: tuple[int, ...], falling: tuple[bool, ...], order: Order
) -> None:
    # How depth changes along i, j and k: no two samples of the cube lie on one ray
    depth = [(-1.0 if down else 1.0) * (2.1, 3.3, 4.7)[m] for m, down in zip(magnitudes, falling, strict=True)]
    geometry = Geometry(CUBE)
    view = View(rotation=quaternion_to((depth[0], depth[1], depth[2])), zoom=16.0)
    scene = plain_scene(view=view, size=(512, 512), order=order)
    plan = plan_frame(scene, geometry, Step.F)
    samples = mapping.samples_of(scene, geometry, plan)
    index_at = {tuple(p): tuple(n) for p, n in zip(samples.lattice.tolist(), samples.indices.tolist(), strict=True)}
    assert len(index_at) == math.prod(CUBE)

    got = [
        index_at[tuple(p)]
        for p in packets_of(walked(geometry, visible_volume(geometry), scene, plan)).position.tolist()
    ]
    loops = sorted(range(3), key=lambda axis: -abs(depth[axis]))
    towards_end = 1 if order == Order.BACK_TO_FRONT else -1
    assert got == sorted(index_at.values(), key=lambda n: [towards_end * depth[axis] * n[axis] for axis in loops])


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("sample_axis", [0, 1, 2])
def test_rows_longer_than_a_runs_offsets_are_split(sample_axis: int, order: Order) -> None:
    size = [2, 2, 2]
    size[sample_axis] = 300
    # The long axis lies in the screen, along a diagonal; the others lead into depth and across it
    rows = [[1.0, -0.8, 0.3], [1.5, -1.5, 0.2], [1.0, 1.0, 2.0]]
    rows[0][sample_axis], rows[1][sample_axis], rows[2][sample_axis] = 5.0, -3.0, 0.5
    x, y, z = ((row[0], row[1], row[2]) for row in rows)
    geometry = Geometry((size[0], size[1], size[2]), (x, y, z))
    scene = plain_scene(view=View(zoom=2 * geometry.reference_spacing), size=WIDE, order=order)
    plan = plan_frame(scene, geometry, Step.F)
    assert plan.traversal.axes[2] == sample_axis
    batches = walked(geometry, visible_volume(geometry), scene, plan)
    assert torch.equal(packets_of(batches).position, mapping.samples_of(scene, geometry, plan).lattice)
    assert (torch.bincount(runs_of(batches).keys[:, 0]) > 2 * len(batches)).all()


@given(data=st.data(), geometry=geometries(), step=st.sampled_from(PAPER_STEPS))
def test_only_samples_that_touch_no_pixel_are_left_out(data: st.DataObject, geometry: Geometry, step: Step) -> None:
    width, height = data.draw(st.integers(1, 60)), data.draw(st.integers(1, 60))
    drawn = data.draw(shaded_scenes(geometry, Image(width=width, height=height)))
    scene = plain_scene(view=drawn.view, order=drawn.order, size=(width, height))
    plan = plan_frame(scene, geometry, step)
    samples = mapping.samples_of(scene, geometry, plan)
    reach = torch.tensor(sample_reach(plan), dtype=torch.float64)
    size = torch.tensor([plan.width, plan.height])
    position = samples.lattice / LATTICE
    near = ((position >= -reach) & (position <= size - 1 + reach)).all(dim=1).tolist()
    got = packets_of(walked(geometry, visible_volume(geometry), scene, plan))
    sent = iter(torch.cat((got.keys, got.position), dim=1).tolist())
    next_sent = next(sent, None)
    for sample, must_be_sent in zip(
        torch.cat((samples.ordinals[:, :2], samples.lattice), 1).tolist(), near, strict=True
    ):
        if sample == next_sent:
            next_sent = next(sent, None)
        else:
            assert not must_be_sent
    assert next_sent is None


def test_a_clipped_block_on_the_sample_axis_stands_alone_in_its_run() -> None:
    geometry = Geometry((21, 1, 1))
    visits = visits_of(0, 21, 4)
    assert visits.block(visits.count - 1) == (16, 21)
    scene = plain_scene(opacity=0.5, view=View(zoom=4.0))
    runs = runs_of(walked(geometry, visible_volume(geometry), scene, plan_frame(scene, geometry, Step.A)))
    assert runs.count.tolist() == [visits.count - 1, 1]


def test_a_batch_keeps_its_bytes_while_it_is_held() -> None:
    geometry = Geometry((16, 16, 16))
    scene = plain_scene(opacity=0.5)
    plan = plan_frame(scene, geometry, Step.F)
    held = sub_cubes(geometry, visible_volume(geometry), PLAIN, [geometry.box])
    walk = FrameWalk(held, Drawing.of(scene, plan, geometry, PLAIN))
    kept, copies = [], []
    for batch in batches_of(walk.walkers[0], max_packets=100):
        kept += parts_of(batch)
        copies += [(bytes(part.runs), bytes(part.packets)) for part in parts_of(batch)]
    del walk, held, batch
    assert [(bytes(part.runs), bytes(part.packets)) for part in kept] == copies


def test_a_server_without_boxes_says_at_once_that_it_is_done() -> None:
    scene, geometry = plain_scene(), Geometry(CUBE)
    plan = plan_frame(scene, geometry, Step.F)
    [walker] = FrameWalk([], Drawing.of(scene, plan, geometry, PLAIN)).walkers
    [batch] = batches_of(walker)
    assert batch.packet_count == batch.voxels_visited == 0
    assert batch.reached == (plan.visits[plan.traversal.axes[0]].count, 0)


def test_a_sub_cube_must_be_packed_before_it_is_walked() -> None:
    scene, geometry = plain_scene(), Geometry(CUBE)
    drawing = Drawing.of(scene, plan_frame(scene, geometry, Step.F), geometry, PLAIN)
    with pytest.raises(LocalProtocolError, match="before it was packed"):
        FrameWalk([SubCube(geometry, geometry.box)], drawing)
