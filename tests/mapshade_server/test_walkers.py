"""Walkers that share a walk, and regions that share an image: together they deliver what one walker does for one."""

import threading
from concurrent.futures import ThreadPoolExecutor

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.arbitrary import geometries, plain_scene, quaternion_to
from support.scenes.owned import owners, wait_until_complete
from support.scenes.rendering import batch_memory
from support.scenes.shaded_packets import batches_of, packets_of, runs_of
from support.scenes.shadings import WINDOW, partitions, shaded_scenes, volumes
from volsplat.mapshade_server._kernels import Batch
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Order, Scene, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, new_tile_map
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import LISTS_PER_PACKET
from volsplat.protocol.rules.packet_layout import VOXEL_PACKET_BYTES
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.regions import Region, check_regions
from volsplat.splat_server._kernels import Bell, ReadBudget
from volsplat.splat_server.frame_assembly import FrameAssembly

PLAIN = Quantisation(window=WINDOW, strength_scale=50.0)
RGBA = 4

Placed = tuple[list[int], list[int]]  # a packet's sheet, row and number in it; and what it is
walker_counts = st.sampled_from((1, 2, 3, 4, 7, 16))


@st.composite
def regions_of(draw: st.DrawFn, lines: int) -> list[Region]:
    """Cut anywhere between tiles: empty ones, too, and such as are one tile high."""
    cuts = sorted(draw(st.lists(st.integers(0, lines // TILE_SIDE), max_size=6)))
    edges = [0, *(cut * TILE_SIDE for cut in cuts), lines]
    regions = [Region(1, begin, end) for begin, end in zip(edges, edges[1:], strict=False)]
    check_regions(regions, lines)
    return regions


def held_as(geometry: Geometry, values: torch.Tensor, boxes: list[Box]) -> list[SubCube]:
    sub_cubes = [SubCube.of_volume(geometry, values, box) for box in boxes]
    for sub_cube in sub_cubes:
        sub_cube.pack(PLAIN)
    return sub_cubes


def walk_of(
    held: list[SubCube],
    scene: Scene,
    plan: FramePlan,
    regions: list[Region],
    walkers: int | None,
    tiles: object = None,
) -> FrameWalk:
    drawing = Drawing.of(scene, plan, held[0].geometry, PLAIN)
    return FrameWalk(held, drawing, tiles, regions, walkers)  # type: ignore[arg-type]


def delivered(walk: FrameWalk, most: int) -> list[list[Batch]]:
    """By each walker, all of which walk at the same time."""
    together = threading.Barrier(len(walk.walkers))

    def all_of(number: int) -> list[Batch]:
        together.wait()
        return list(batches_of(walk.walkers[number], most, 4 * most))

    with ThreadPoolExecutor(len(walk.walkers)) as threads:
        return list(threads.map(all_of, range(len(walk.walkers))))


def placed(batches: list[Batch], region: int = 0) -> list[Placed]:
    runs = runs_of(batches, region)
    packets = packets_of(batches, region).rows()
    places = [
        [sheet, row, first + at]
        for (sheet, row, first), count in zip(runs.keys.tolist(), runs.count.tolist(), strict=True)
        for at in range(count)
    ]
    return list(zip(places, packets, strict=True))


def merged(of_walkers: list[list[Batch]], region: int = 0) -> list[list[int]]:
    """By the key of the merge."""
    return [
        packet
        for _, packet in sorted((one for sent in of_walkers for one in placed(sent, region)), key=lambda one: one[0])
    ]


def image_lines(plan: FramePlan, of_walkers: list[list[Batch]], region: int = 0) -> torch.Tensor:
    """What a splat server makes of a region's parts: the plan's lines."""
    news = Bell()
    with owners() as made:
        assembly = FrameAssembly(made, plan, frame=1)
        assembly.begin([Region(1, 0, plan.height)], len(of_walkers), news)
        for walker, batches in enumerate(of_walkers):
            for batch in batches:
                alone = batch_memory([parts_of(batch)[region]], ReadBudget(1, news))
                assembly.splat.push(walker, alone, *batch.reached, batch.last)
        wait_until_complete(assembly.splat, news)
        width, height = plan.image_size
        image = torch.frombuffer(bytearray(assembly.published()), dtype=torch.float32).reshape(height, width, RGBA)
    return image.transpose(0, 1) if plan.turned else image


@given(data=st.data(), geometry=geometries(largest=24), step=st.sampled_from(PAPER_STEPS), walkers=walker_counts)
def test_regions_get_what_makes_up_their_lines(
    data: st.DataObject, geometry: Geometry, step: Step, walkers: int
) -> None:
    size = Image(width=data.draw(st.integers(1, 90)), height=data.draw(st.integers(1, 90)))
    scene = data.draw(shaded_scenes(geometry, size))
    held = held_as(geometry, data.draw(volumes(geometry)), data.draw(partitions(geometry)))
    plan = msgspec.structs.replace(plan_frame(scene, geometry, step), edges=())
    regions = data.draw(regions_of(plan.height))
    most = data.draw(st.sampled_from((20, 1000)))
    whole = delivered(walk_of(held, scene, plan, [], 1), most)
    parts = delivered(walk_of(held, scene, plan, regions, walkers), most)
    expected, everything = image_lines(plan, whole), merged(whole)
    for number, region in enumerate(regions):
        own = merged(parts, number)
        left = iter(everything)
        assert all(packet in left for packet in own)  # in the same order
        lines = slice(region.begin, region.end)
        assert torch.equal(image_lines(plan, parts, number)[lines], expected[lines])
        assert region.begin < region.end or not own
    assert visited(parts) == visited(whole)


@given(data=st.data(), geometry=geometries(largest=24), step=st.sampled_from((*PAPER_STEPS, Step.G)))
def test_a_regions_own_walker_delivers_what_all_walkers_do_for_it(
    data: st.DataObject, geometry: Geometry, step: Step
) -> None:
    size = Image(width=data.draw(st.integers(1, 90)), height=data.draw(st.integers(1, 90)))
    scene = data.draw(shaded_scenes(geometry, size))
    held = held_as(geometry, data.draw(volumes(geometry)), data.draw(partitions(geometry)))
    plan = plan_frame(scene, geometry, step)
    regions, most = data.draw(regions_of(plan.height)), data.draw(st.sampled_from((20, 1000)))
    together = delivered(walk_of(held, scene, plan, regions, 2), most)
    own = delivered(walk_of(held, scene, plan, regions, None), most)
    assert len(own) == len(regions)
    for number, batches in enumerate(own):
        assert placed(batches) == sorted(placed_by_all(together, number))


def placed_by_all(of_walkers: list[list[Batch]], region: int) -> list[Placed]:
    return [one for sent in of_walkers for one in placed(sent, region)]


def visited(of_walkers: list[list[Batch]]) -> int:
    return sum(batch.voxels_visited for batches in of_walkers for batch in batches)


@given(data=st.data(), geometry=geometries(largest=40), step=st.sampled_from(PAPER_STEPS), walkers=walker_counts)
def test_walkers_deliver_each_sample_once_whatever_was_walked_before(
    data: st.DataObject, geometry: Geometry, step: Step, walkers: int
) -> None:
    values, boxes = data.draw(volumes(geometry)), data.draw(partitions(geometry))
    held = held_as(geometry, values, boxes)
    for scene in (data.draw(shaded_scenes(geometry)) for _ in range(2)):
        plan = plan_frame(scene, geometry, step)
        fresh = delivered(walk_of(held_as(geometry, values, boxes), scene, plan, [], 1), 1000)
        for _ in range(2):
            assert merged(delivered(walk_of(held, scene, plan, [], walkers), 1000)) == merged(fresh)
        for sub_cube in held:
            assert sub_cube.classified_rows.bytes <= LISTS_PER_PACKET * VOXEL_PACKET_BYTES * sub_cube.box.voxels


@given(data=st.data(), geometry=geometries(), step=st.sampled_from(PAPER_STEPS), walkers=walker_counts)
def test_each_walkers_keys_rise_and_nothing_comes_before_what_it_had_reached(
    data: st.DataObject, geometry: Geometry, step: Step, walkers: int
) -> None:
    scene, values = data.draw(shaded_scenes(geometry)), data.draw(volumes(geometry))
    plan = plan_frame(scene, geometry, step)
    regions = data.draw(regions_of(plan.height))
    held = held_as(geometry, values, data.draw(partitions(geometry)))
    end_of_all = (plan.visits[plan.traversal.axes[0]].count, 0)
    for batches in delivered(walk_of(held, scene, plan, regions, walkers), data.draw(st.integers(1, 40))):
        ends = [[0, 0, 0] for _ in regions]
        reached = (0, 0)
        for batch in batches:
            for number in range(len(regions)):
                for place, _ in placed([batch], number):
                    assert (place[0], place[1]) >= reached and place >= ends[number]
                    ends[number] = [*place[:2], place[2] + 1]
            assert batch.reached >= reached
            reached = batch.reached
        assert batches[-1].last and reached == end_of_all


LARGE = 128
TOWARDS = {"i": (0.1, 0.5, 1.0), "j": (0.5, 0.1, 1.0), "k": (0.5, 1.0, 0.1), "sheets along i": (1.0, 0.1, 0.5)}


@pytest.mark.parametrize("step", [Step.A, Step.B, Step.F])
@pytest.mark.parametrize("axis", TOWARDS)
def test_walkers_have_as_much_to_do(axis: str, step: Step) -> None:
    geometry = Geometry((LARGE, LARGE, LARGE))
    held = held_as(geometry, torch.ones(geometry.dims), [geometry.box])
    scene = plain_scene(view=View(rotation=quaternion_to(TOWARDS[axis])), size=(256, 256))
    plan = plan_frame(scene, geometry, step)
    for walkers in (2, 4):
        of_walkers = delivered(walk_of(held, scene, plan, [], walkers), 1 << 16)
        busiest = max(visited([batches]) for batches in of_walkers)
        assert busiest < 1.2 * visited(of_walkers) / walkers


def test_a_regions_own_walker_visits_little_beyond_it() -> None:
    geometry = Geometry((LARGE, LARGE, LARGE))
    held = held_as(geometry, torch.ones(geometry.dims), [geometry.box])
    scene = plain_scene(view=View(rotation=quaternion_to((0.3, 0.2, 1.0)), zoom=1.5), size=(256, 256))
    plan = plan_frame(scene, geometry, Step.F)
    whole = visited(delivered(walk_of(held, scene, plan, [], 1), 1 << 16))
    regions = [Region(1, line, line + 64) for line in range(0, plan.height, 64)]
    for batches in delivered(walk_of(held, scene, plan, regions, None), 1 << 16):
        assert visited([batches]) < 0.45 * whole
    assert visited(delivered(walk_of(held, scene, plan, regions, None), 1 << 16)) < 1.4 * whole


@pytest.mark.parametrize("axis", TOWARDS)
def test_walkers_share_the_lists_of_rows(axis: str) -> None:
    geometry = Geometry((LARGE, LARGE, LARGE))
    values = torch.randn(geometry.dims, generator=torch.Generator().manual_seed(4))
    opac = ScalarTable(points=((0.0, 0.0), (0.9, 0.0), (0.9, 0.2), (1.0, 1.0)))
    scene = plain_scene(view=View(rotation=quaternion_to(TOWARDS[axis])), size=(256, 256))
    scene = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=opac))
    plan = plan_frame(scene, geometry, Step.F)
    one, many = held_as(geometry, values, [geometry.box]), held_as(geometry, values, [geometry.box])
    alone = merged(delivered(walk_of(one, scene, plan, [], 1), 1 << 16))
    for _ in range(2):
        assert merged(delivered(walk_of(many, scene, plan, [], 8), 1 << 10)) == alone
        assert many[0].classified_rows.axes == one[0].classified_rows.axes
    assert len(many[0].classified_rows.axes) == 1


def test_closed_tiles_hide_from_all_walkers() -> None:
    side, size = 24, 96
    geometry = Geometry((side, side, side))
    held = held_as(geometry, torch.ones(geometry.dims), [geometry.box])
    scene = plain_scene(view=View(zoom=4.0), size=(size, size), order=Order.FRONT_TO_BACK)
    plan = plan_frame(scene, geometry, Step.F)
    tiles = new_tile_map(plan.width, plan.height)
    tiles.cast("B")[:] = b"\xff" * tiles.nbytes
    for walkers in (3, None):
        for batches in delivered(walk_of(held, scene, plan, [], walkers, tiles), 100):
            assert merged([batches]) == []


def test_what_is_open_elsewhere_hides_nothing_less_from_a_regions_own_walker() -> None:
    side, size, edge = 24, 96, 48
    geometry = Geometry((side, side, side))
    held = held_as(geometry, torch.ones(geometry.dims), [geometry.box])
    scene = plain_scene(view=View(zoom=4.0), size=(size, size), order=Order.FRONT_TO_BACK)
    plan = plan_frame(scene, geometry, Step.F)
    tiles = new_tile_map(plan.width, plan.height)
    half = tiles.nbytes // 2
    tiles.cast("B")[half:] = b"\xff" * (tiles.nbytes - half)
    regions = [Region(1, 0, edge), Region(1, edge, size)]
    above, below = delivered(walk_of(held, scene, plan, regions, None, tiles), 100)
    assert merged([below]) == []
    assert merged([above]) == merged(delivered(walk_of(held, scene, plan, regions, 1), 100))


def test_a_frame_has_a_walk_for_each_region_or_none() -> None:
    geometry = Geometry((8, 8, 8))
    held, scene = held_as(geometry, torch.ones(8, 8, 8), [geometry.box]), plain_scene(size=(96, 96))
    plan = plan_frame(scene, geometry, Step.F)
    regions = [Region(1, 0, 40), Region(1, 40, 96)]
    walks = walk_of(held, scene, plan, regions, None).walkers
    with owners(2) as made:
        assembly = FrameAssembly(made, plan, frame=1)
        for sources, some in ((0, walks[:1]), (2, walks)):
            with pytest.raises(ValueError, match="a walk for each region"):
                assembly.begin(regions, sources, Bell(), walks=some)


@pytest.mark.parametrize("lines", [[(0, 90)], [(0, 70), (70, 96)], [(0, 32), (40, 96)], [(0, 64), (64, 32), (32, 96)]])
def test_regions_of_another_image_are_refused(lines: list[tuple[int, int]]) -> None:
    geometry = Geometry((8, 8, 8))
    held, scene = held_as(geometry, torch.ones(8, 8, 8), [geometry.box]), plain_scene(size=(96, 96))
    regions = [Region(1, begin, end) for begin, end in lines]
    with pytest.raises(ValueError, match="regions"):
        walk_of(held, scene, plan_frame(scene, geometry, Step.F), regions, 1)
