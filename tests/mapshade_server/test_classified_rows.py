"""What a walk keeps of rows from frame to frame, and what it leaves out as hidden, changes its cost only."""

import math
import subprocess
import sys
from array import array
from dataclasses import dataclass

import msgspec
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from torch import Tensor

from reference import mapping
from support.checkout import ROOT
from support.patience import PATIENCE
from support.programs.little_memory import little_memory
from support.scenes.arbitrary import (
    bounds_within,
    flips_and_orders,
    geometries,
    plain_scene,
    quaternion_to,
    quaternions,
    views,
)
from support.scenes.owned import owners, wait_until_complete
from support.scenes.rendering import batch_memory
from support.scenes.shaded_packets import all_batches, batches_of, packets_of
from support.scenes.shadings import WINDOW, partitions, shaded_scenes, volumes
from volsplat.bench.floors.cpu_paths import kernels_on
from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server._kernels import Batch
from volsplat.mapshade_server.frames.frame_walk import DEFAULT_VOXELS, FrameWalk, sample_reach
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Image, Order, Scene, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, WORD_TILES, tile_map_shape
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import (
    ALL_VOXELS,
    LISTS_PER_PACKET,
    LISTS_PER_STORED_PACKET,
    Thinning,
    own_resolution,
)
from volsplat.protocol.rules.packet_layout import VOXEL_PACKET_BYTES
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.regions import Region
from volsplat.splat_server._kernels import Bell, ReadBudget
from volsplat.splat_server.frame_assembly import FrameAssembly

LATTICE = 64
SPARED = 1.2  # pixels: further from an open tile a hidden sample is sure to be left out
PLAIN = Quantisation(window=WINDOW, strength_scale=50.0)
STEPS_OF_ALL_VOXELS = (Step.C, Step.D, Step.E, Step.F)
THINNED = (Thinning(sheets=2), Thinning(sheets=2, rows=2), Thinning(rows=4), Thinning(octaves=1))
SIDE = 24
CUBE = Geometry((SIDE, SIDE, SIDE))
TOWARDS = {"i": (0.1, 0.5, 1.0), "j": (0.5, 0.1, 1.0), "k": (0.5, 1.0, 0.1)}  # how depth changes, by sample axis


def held_as(geometry: Geometry, values: Tensor, boxes: list[Box]) -> list[SubCube]:
    sub_cubes = [SubCube.of_volume(geometry, values, box) for box in boxes]
    for sub_cube in sub_cubes:
        sub_cube.pack(PLAIN)
    return sub_cubes


@dataclass(frozen=True)
class Frame:
    batches: list[Batch]

    @property
    def rows(self) -> list[list[int]]:
        return packets_of(self.batches).rows()

    @property
    def visited(self) -> int:
        return sum(batch.voxels_visited for batch in self.batches)


def walk_of(
    held: list[SubCube],
    scene: Scene,
    step: Step = Step.F,
    closed_tiles: "_kernels.Array | None" = None,
    thinning: Thinning = ALL_VOXELS,
) -> FrameWalk:
    geometry = held[0].geometry
    plan = plan_frame(scene, geometry, step, own_resolution(geometry, step, thinning)).upright
    return FrameWalk(held, Drawing.of(scene, plan, geometry, PLAIN), closed_tiles)


def frame(
    held: list[SubCube],
    scene: Scene,
    step: Step = Step.F,
    closed_tiles: "_kernels.Array | None" = None,
    most: int = 999,
    thinning: Thinning = ALL_VOXELS,
) -> Frame:
    return Frame(all_batches(walk_of(held, scene, step, closed_tiles, thinning), most, most))


def sparse(scene: Scene, least: float) -> Scene:
    """The scene with nothing to be seen below a density of `least`."""
    opac = ScalarTable(points=((0.0, 0.0), (least, 0.0), (least, 0.2), (1.0, 1.0)))
    return msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=opac))


def seen_from(axis: str, least: float = 0.85) -> Scene:
    """A view whose samples follow an axis, of densities from `least` up."""
    return sparse(plain_scene(view=View(rotation=quaternion_to(TOWARDS[axis])), size=(2048, 2048)), least)


@given(data=st.data(), geometry=geometries(largest=40), path=st.sampled_from(_kernels.cpu_paths()))
def test_a_frame_is_the_same_whatever_was_walked_before(data: st.DataObject, geometry: Geometry, path: str) -> None:
    values, boxes = data.draw(volumes(geometry)), data.draw(partitions(geometry))
    scenes = [data.draw(shaded_scenes(geometry)), sparse(data.draw(shaded_scenes(geometry)), 0.8)]
    steps, thinnings = st.sampled_from(PAPER_STEPS), st.sampled_from([ALL_VOXELS, *THINNED])
    with kernels_on(_kernels, path):
        held = held_as(geometry, values, boxes)
        for _ in range(data.draw(st.integers(2, 6))):
            scene = msgspec.structs.replace(
                data.draw(st.sampled_from(scenes)),
                view=data.draw(views(geometry.dims)),
                bounds=data.draw(bounds_within(geometry.dims)),
            )
            step = data.draw(steps)
            thinning = data.draw(thinnings) if step in STEPS_OF_ALL_VOXELS else ALL_VOXELS
            anew = held_as(geometry, values, boxes)
            after, fresh = frame(held, scene, step, thinning=thinning), frame(anew, scene, step, thinning=thinning)
            assert after.rows == fresh.rows
            assert after.visited == fresh.visited
            for sub_cube in held:
                assert sub_cube.classified_rows.bytes <= LISTS_PER_PACKET * VOXEL_PACKET_BYTES * sub_cube.box.voxels


def test_packets_from_a_store_have_smaller_lists() -> None:
    values = torch.rand(SIDE, SIDE, SIDE, generator=torch.Generator().manual_seed(1))
    [packed] = held_as(CUBE, values, [CUBE.box])
    stored = SubCube.of_packets(CUBE, CUBE.box, packed.packets, LISTS_PER_STORED_PACKET)
    most = LISTS_PER_STORED_PACKET * VOXEL_PACKET_BYTES * CUBE.box.voxels
    for axis in TOWARDS:  # each list takes a quarter of the packets' bytes or more
        scene = seen_from(axis, 0.72)
        assert frame([stored], scene).rows == frame([packed], scene).rows
        assert 0 < stored.classified_rows.bytes <= most
    assert len(stored.classified_rows.axes) < len(packed.classified_rows.axes)


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_all_48_traversals_are_served_by_lists_in_any_sequence(order: Order) -> None:
    geometry = Geometry((35, 20, 17))
    values = torch.randn(17, 20, 35, generator=torch.Generator().manual_seed(1))
    held = held_as(geometry, values, [geometry.box])
    kept = set()
    for magnitudes, falling in flips_and_orders():
        depth = [(-1.0 if down else 1.0) * (2.1, 3.3, 4.7)[m] for m, down in zip(magnitudes, falling, strict=True)]
        view = View(rotation=quaternion_to((depth[0], depth[1], depth[2])), zoom=3.0)
        scene = sparse(plain_scene(view=view, order=order, size=(512, 512)), 0.9)
        assert frame(held, scene).rows == frame(held_as(geometry, values, [geometry.box]), scene).rows
        kept |= set(held[0].classified_rows.axes)
    assert kept == {0, 1, 2}


@pytest.mark.parametrize("axis", TOWARDS)
def test_lists_made_while_sheets_are_left_out_hold_all_that_is_seen(axis: str) -> None:
    values = torch.randn(SIDE, SIDE, SIDE, generator=torch.Generator().manual_seed(1))
    held, scene = held_as(CUBE, values, [CUBE.box]), seen_from(axis)
    for thinning in THINNED:
        frame(held, scene, thinning=thinning)
    assert frame(held, scene).rows == frame(held_as(CUBE, values, [CUBE.box]), scene).rows


def test_steps_of_all_voxels_share_lists_and_others_make_none() -> None:
    held = held_as(CUBE, torch.randn(SIDE, SIDE, SIDE), [CUBE.box])
    rows = held[0].classified_rows
    for step in (Step.A, Step.B):
        frame(held, seen_from("j"), step)
        assert rows.axes == [] and rows.bytes == 0
    sizes = set()
    for step in STEPS_OF_ALL_VOXELS:
        frame(held, seen_from("j"), step)
        sizes.add(rows.bytes)
    assert rows.axes == [1] and len(sizes) == 1


@pytest.mark.parametrize("axis", TOWARDS)
def test_only_what_was_walked_is_classified(axis: str) -> None:
    held = held_as(CUBE, torch.randn(SIDE, SIDE, SIDE), [CUBE.box])
    rows, scene = held[0].classified_rows, seen_from(axis)
    far_away = msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom=256.0, center=(1e4, 0, 0)))
    frame(held, far_away)
    none = rows.bytes
    frame(held, scene)
    assert rows.bytes > none


def test_other_tables_forget_the_lists() -> None:
    held = held_as(CUBE, torch.randn(SIDE, SIDE, SIDE), [CUBE.box])
    rows = held[0].classified_rows
    for axis in "ij":
        frame(held, seen_from(axis, least=0.9))
    many = rows.bytes
    assert rows.axes == [0, 1]
    frame(held, seen_from("j", least=0.95))
    assert rows.axes == [1] and rows.bytes < many


def test_packing_anew_forgets_the_lists() -> None:
    values = torch.randn(SIDE, SIDE, SIDE)
    sub_cube = held_as(CUBE, values, [CUBE.box])[0]
    frame([sub_cube], seen_from("i"))
    sub_cube.hold(-values)
    sub_cube.pack(PLAIN)
    assert sub_cube.classified_rows.axes == []
    assert frame([sub_cube], seen_from("i")).rows == frame(held_as(CUBE, -values, [CUBE.box]), seen_from("i")).rows


def test_the_axis_that_was_walked_the_longest_ago_gives_way() -> None:
    held = held_as(CUBE, torch.linspace(-2, 2, SIDE**3).reshape(SIDE, SIDE, SIDE), [CUBE.box])
    rows, least = held[0].classified_rows, 0.9  # a tenth to be seen: two axes have room, three have not
    for axis, kept in (("i", [0]), ("j", [0, 1]), ("k", [1, 2]), ("j", [1, 2]), ("i", [0, 1]), ("i", [0, 1])):
        frame(held, seen_from(axis, least))
        assert rows.axes == kept


@pytest.mark.parametrize("axis", TOWARDS)
def test_where_nearly_all_can_be_seen_no_lists_are_kept(axis: str) -> None:
    held = held_as(CUBE, torch.randn(SIDE, SIDE, SIDE), [CUBE.box])
    first = frame(held, seen_from(axis, least=0.2))
    assert held[0].classified_rows.axes == []
    assert frame(held, seen_from(axis, least=0.2)).rows == first.rows


@given(
    views=st.lists(st.tuples(st.sampled_from("ijk"), st.sampled_from((0.2, 0.6, 0.85, 0.9))), min_size=2, max_size=4),
    sequence=st.lists(st.integers(0, 3), max_size=60),
)
@example(views=[("i", 0.85), ("i", 0.85)], sequence=[0, 1] * 20)
@example(views=[("i", 0.85), ("k", 0.85)], sequence=[0, 1] * 20)
@example(views=[("j", 0.85), ("j", 0.6)], sequence=[0, 1] * 20)  # other tables …
@example(views=[("j", 0.6), ("j", 0.9)], sequence=[0, 1, 1, 1] * 10)
@example(views=[("k", 0.85), ("k", 0.9), ("k", 0.85)], sequence=[0, 1, 0, 2, 0, 1])  # … and those of before again
@example(views=[("j", 0.85), ("i", 0.2)], sequence=[0, 1] * 20)  # more than there is room for
def test_a_walk_gives_the_same_whichever_walks_begin_meanwhile(
    views: list[tuple[str, float]], sequence: list[int]
) -> None:
    values = torch.randn(SIDE, SIDE, SIDE, generator=torch.Generator().manual_seed(2))
    held, scenes = held_as(CUBE, values, [CUBE.box]), [seen_from(*view) for view in views]
    walks: dict[int, FrameWalk] = {}
    batches: list[list[Batch]] = [[] for _ in scenes]
    for turn in (n % len(scenes) for n in sequence):
        if turn not in walks:
            walks[turn] = walk_of(held, scenes[turn])
        batches[turn].append(walks[turn].walkers[0].next_batch(100, 500))
    for turn, walk in walks.items():
        rows = packets_of(batches[turn] + all_batches(walk)).rows()
        assert rows == frame(held_as(CUBE, values, [CUBE.box]), scenes[turn]).rows


def draw_without_memory_for_lists() -> None:
    """To be called in a process of its own: no memory that others have let go of may serve the lists."""
    side = 272  # so that the lists take more than is left
    geometry = Geometry((side, side, side))
    values = torch.zeros(side, side, side)
    values[::16, ::16, ::16] = 2
    held, scene = held_as(geometry, values, [geometry.box]), seen_from("j")
    with little_memory(32 << 20):
        without = frame(held, scene, most=side**3)
    assert held[0].classified_rows.axes == []
    assert without.rows == frame(held_as(geometry, values, [geometry.box]), scene).rows


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to the limit")
def test_without_memory_for_lists_a_frame_is_the_same() -> None:
    program = "from mapshade_server.test_classified_rows import draw_without_memory_for_lists as draw; draw()"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT / "tests", capture_output=True, encoding="utf-8", timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("sample_axis", [0, 1, 2])
@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_rows_longer_than_positions_count_are_walked_in_pieces(sample_axis: int, order: Order) -> None:
    size, towards = [2, 2, 2], [1.0, 2.0, 3.0]
    size[sample_axis], towards[sample_axis] = 66000, 0.0001
    geometry = Geometry((size[0], size[1], size[2]))
    view = View(rotation=quaternion_to((towards[0], towards[1], towards[2])), zoom=0.1)
    scene = plain_scene(view=view, size=(8192, 8192), order=order)
    plan = plan_frame(scene, geometry, Step.F).upright
    assert plan.traversal.axes[2] == sample_axis
    got = packets_of(frame(held_as(geometry, torch.ones(geometry.dims[::-1]), [geometry.box]), scene).batches)
    assert torch.equal(got.position, mapping.samples_of(scene, geometry, plan).lattice)


# -- closed tiles


def tile_map(closed: Tensor, width: int, height: int) -> memoryview:
    """The map of tiles (rows, columns), bool."""
    rows, words = tile_map_shape(width, height)
    numbers = array("Q", bytes(8 * rows * words))
    for row, column in closed.nonzero().tolist():
        numbers[row * words + column // WORD_TILES] |= 1 << column % WORD_TILES
    return memoryview(numbers).cast("B").cast("Q", (rows, words))


def tiles(width: int, height: int, closed: bool = False) -> Tensor:
    return torch.full((-(-height // TILE_SIDE), -(-width // TILE_SIDE)), closed)


@st.composite
def mostly_closed(draw: st.DrawFn, width: int, height: int) -> Tensor:
    """All tiles closed but for a few rectangles of them."""
    closed = tiles(width, height, closed=True)
    rows, columns = closed.shape
    for _ in range(draw(st.integers(1, 4))):
        top, left = draw(st.integers(0, rows - 1)), draw(st.integers(0, columns - 1))
        closed[top : top + draw(st.integers(1, 3)), left : left + draw(st.integers(1, 3))] = False
    return closed


def reached_tiles(position: list[int], reach: tuple[float, float]) -> tuple[slice, slice]:
    """Rows and columns of the tiles whose pixels a footprint at a position (1/64 pixel) covers."""
    ranges = []
    for place, far in zip(position, reach, strict=True):
        first, last = math.ceil(place / LATTICE - far), math.floor(place / LATTICE + far)
        ranges.append(slice(max(first, 0) // TILE_SIDE, max(last + TILE_SIDE, 0) // TILE_SIDE))
    return ranges[1], ranges[0]


def assert_hidden_ones_are_left_out(
    all_rows: list[list[int]], some: list[list[int]], closed: Tensor, scene: Scene, geometry: Geometry = CUBE
) -> None:
    """Of all packets some were sent: none is missing that reaches an open tile, nor sent that is far from each."""
    reach = sample_reach(plan_frame(scene, geometry, Step.F).upright)
    spared = (reach[0] + SPARED, reach[1] + SPARED)
    size = (scene.image.width, scene.image.height)
    for row in some:
        if all(far <= place / LATTICE < pixels for place, far, pixels in zip(row[2:4], spared, size, strict=True)):
            assert not closed[reached_tiles(row[2:4], spared)].all()
    left = iter(some)
    expected = next(left, None)
    for row in all_rows:
        if row == expected:
            expected = next(left, None)
        else:
            assert closed[reached_tiles(row[2:4], reach)].all()
    assert expected is None


@given(data=st.data(), rotation=quaternions, share=st.sampled_from((0.05, 0.5, 1.0)))
def test_only_samples_that_reach_closed_tiles_alone_are_left_out_and_nearly_all_of_them(
    data: st.DataObject, rotation: tuple[float, float, float, float], share: float
) -> None:
    width, height, zoom = data.draw(st.integers(20, 300)), data.draw(st.integers(20, 300)), data.draw(st.floats(1, 6))
    scene = plain_scene(view=View(rotation=rotation, zoom=zoom), size=(width, height), order=Order.FRONT_TO_BACK)
    generator = torch.Generator().manual_seed(data.draw(st.integers(0, 99)))
    values = (torch.rand(CUBE.dims, generator=generator) < share).float() * 4 - 2
    held = held_as(CUBE, values, data.draw(partitions(CUBE)))
    closed = data.draw(mostly_closed(width, height))
    all_sent = frame(held, scene)
    on_each_path = []
    for path in _kernels.cpu_paths():
        with kernels_on(_kernels, path):
            on_each_path.append(frame(held, scene, Step.F, tile_map(closed, width, height)))
    some_sent = on_each_path[0]
    assert some_sent.visited == all_sent.visited
    assert all(other.rows == some_sent.rows for other in on_each_path)
    assert_hidden_ones_are_left_out(all_sent.rows, some_sent.rows, closed, scene)


def test_most_of_what_is_hidden_is_left_out() -> None:
    scene = plain_scene(view=View(zoom=4.0), size=(4 * SIDE, 4 * SIDE), order=Order.FRONT_TO_BACK)
    held = held_as(CUBE, torch.ones(SIDE, SIDE, SIDE), [CUBE.box])
    closed = tiles(4 * SIDE, 4 * SIDE, closed=True)
    closed[SIDE // 2, SIDE // 2] = False
    reach = sample_reach(plan_frame(scene, CUBE, Step.F).upright)
    positions = [row[2:4] for row in frame(held, scene).rows]
    needed = sum(not closed[reached_tiles(position, reach)].all() for position in positions)
    sent = len(frame(held, scene, Step.F, tile_map(closed, 4 * SIDE, 4 * SIDE)).rows)
    assert needed <= sent < len(positions) / 4


@given(data=st.data(), rotation=quaternions, zoom=st.floats(1, 6))
def test_what_is_closed_meanwhile_is_left_out_from_the_next_batch_on(
    data: st.DataObject, rotation: tuple[float, float, float, float], zoom: float
) -> None:
    width, height = data.draw(st.integers(20, 200)), data.draw(st.integers(20, 200))
    scene = plain_scene(view=View(rotation=rotation, zoom=zoom), size=(width, height), order=Order.FRONT_TO_BACK)
    held = held_as(CUBE, torch.ones(SIDE, SIDE, SIDE), [CUBE.box])
    in_the_end = data.draw(mostly_closed(width, height))
    at_first = in_the_end & (torch.rand(in_the_end.shape, generator=torch.Generator().manual_seed(7)) < 0.7)
    live = tile_map(tiles(width, height), width, height)
    walk = walk_of(held, scene, Step.F, live)
    for closed in (at_first, in_the_end):
        walk.walkers[0].next_batch(500, DEFAULT_VOXELS)
        live.cast("B")[:] = tile_map(closed, width, height).cast("B")
    rest = packets_of(all_batches(walk)).rows()
    all_rest = frame(held, scene).rows
    all_rest = all_rest[all_rest.index(rest[0]) :] if rest else []
    assert_hidden_ones_are_left_out(all_rest, rest, in_the_end, scene)


@pytest.mark.parametrize("roll", [0.0, 0.002])
@pytest.mark.parametrize("zoom", [1.0, 3.2])
def test_hidden_samples_are_found_on_an_image_of_any_size(zoom: float, roll: float) -> None:
    length, width, height = 5000, 16384, 80
    geometry = Geometry((length, 3, 3))
    held = held_as(geometry, torch.ones(3, 3, length), [geometry.box])
    scene = plain_scene(view=View(rotation=(0, 0, roll, 1), zoom=zoom), size=(width, height), order=Order.FRONT_TO_BACK)
    closed = torch.rand(tiles(width, height).shape, generator=torch.Generator().manual_seed(3)) < 0.97
    all_sent, some_sent = frame(held, scene), frame(held, scene, Step.F, tile_map(closed, width, height))
    assert_hidden_ones_are_left_out(all_sent.rows, some_sent.rows, closed, scene, geometry)
    assert 0 < len(some_sent.rows) < len(all_sent.rows) / 2


def image_of(held: list[SubCube], scene: Scene, step: Step, most: int, live: bool) -> tuple[bytes, int]:
    """The finished image, and how many packets it took; `live` hides by the image's own closed tiles."""
    geometry, news = held[0].geometry, Bell()
    budget = ReadBudget(1, news)
    with owners() as made:
        assembly = FrameAssembly(made, plan_frame(scene, geometry, step), frame=1)
        plan, tiles = assembly.plan, assembly.closed_tiles if live else None
        walk = FrameWalk(held, Drawing.of(scene, plan, geometry, PLAIN), tiles)
        assembly.begin([Region(1, 0, plan.height)], 1, news)
        for batch in batches_of(walk.walkers[0], most, most):
            assembly.splat.push(0, batch_memory(parts_of(batch), budget), *batch.reached, batch.last)
            heard = news.rung
            while not budget.open and not assembly.splat.complete:
                heard = news.wait(heard, PATIENCE)
        wait_until_complete(assembly.splat, news)
        return bytes(assembly.published()), assembly.splat.packets


@given(data=st.data(), geometry=geometries(largest=24), step=st.sampled_from((Step.A, Step.C, Step.D, Step.F)))
def test_the_live_map_of_closed_tiles_changes_no_bit_of_the_image(
    data: st.DataObject, geometry: Geometry, step: Step
) -> None:
    width, height = data.draw(st.integers(1, 100)), data.draw(st.integers(1, 100))
    drawn = data.draw(shaded_scenes(geometry, Image(width=width, height=height)))
    scene = msgspec.structs.replace(sparse(drawn, data.draw(st.floats(0, 0.6))), order=Order.FRONT_TO_BACK)
    held = held_as(geometry, data.draw(volumes(geometry)), data.draw(partitions(geometry)))
    most = data.draw(st.sampled_from((50, 1000)))
    assert image_of(held, scene, step, most, live=True)[0] == image_of(held, scene, step, most, live=False)[0]


def test_what_is_behind_an_opaque_wall_is_not_sent() -> None:
    held = held_as(CUBE, torch.ones(SIDE, SIDE, SIDE), [CUBE.box])
    scene = plain_scene(view=View(zoom=4.0), size=(SIDE * 4, SIDE * 4), order=Order.FRONT_TO_BACK)
    image, packets = image_of(held, scene, Step.F, 1000, live=True)
    everything, all_packets = image_of(held, scene, Step.F, 1000, live=False)
    assert image == everything
    assert all_packets == SIDE**3 and packets < 0.7 * all_packets


@given(data=st.data(), geometry=geometries(), step=st.sampled_from((Step.D, Step.F)))
def test_nothing_is_sent_to_an_image_that_is_closed(data: st.DataObject, geometry: Geometry, step: Step) -> None:
    drawn = data.draw(shaded_scenes(geometry, Image(width=90, height=70)))
    scene = msgspec.structs.replace(drawn, order=Order.FRONT_TO_BACK)
    held = held_as(geometry, data.draw(volumes(geometry)), [geometry.box])
    assert frame(held, scene, step, tile_map(tiles(90, 70, closed=True), 90, 70)).rows == []


@given(rotation=quaternions, order=st.sampled_from(TRAVERSAL_ORDERS), step=st.sampled_from(PAPER_STEPS))
def test_closed_tiles_count_from_front_to_back_only(
    rotation: tuple[float, float, float, float], order: Order, step: Step
) -> None:
    scene = plain_scene(view=View(rotation=rotation, zoom=2.0), order=order, size=(90, 70))
    held = held_as(CUBE, torch.ones(SIDE, SIDE, SIDE), [CUBE.box])
    closed = tile_map(tiles(90, 70, closed=True), 90, 70)
    hides = order == Order.FRONT_TO_BACK
    assert (frame(held, scene, step, closed).rows == []) == hides


def test_a_map_of_another_image_is_refused() -> None:
    scene = plain_scene(order=Order.FRONT_TO_BACK, size=(90, 70))
    held = held_as(CUBE, torch.ones(SIDE, SIDE, SIDE), [CUBE.box])
    with pytest.raises(ValueError, match="map of closed tiles"):
        frame(held, scene, closed_tiles=tile_map(tiles(90, 75), 90, 75))
