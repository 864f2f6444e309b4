"""Coded batches: what a walk sends comes back as the same bytes, and what no walk sends is refused, never obeyed."""

import pytest
import torch
import zstandard
from hypothesis import assume, given
from hypothesis import strategies as st

from support.scenes.arbitrary import geometries, plain_scene
from support.scenes.coded_batches import (
    Sample,
    bytes_of_code,
    code_of,
    counts_of,
    part_of,
    placed,
    raw_bytes,
    written_code,
)
from support.scenes.shaded_packets import all_batches
from support.scenes.shadings import WINDOW, partitions, shaded_scenes, volumes
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.batch_coder import CLOSE, QUICK, BatchCoder, VoxelBatchCoder, coder_of
from volsplat.mapshade_server.links.shaded_part import ShadedPart, parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Image, Order, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.messages import BatchPart
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.packet_layout import OPACITY_CODES
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.rules.sample_lattice import sample_lattice
from volsplat.splat_server._kernels import largest_code
from volsplat.splat_server.batch_decoder import decoded

PLAIN = Quantisation(window=WINDOW, strength_scale=50.0)
LONG = Geometry((3, 5, 4000))  # its rows go on for longer than one byte counts
TURN = (0.3, 0.4, 0.1, 0.8)


def there_and_back(plan: FramePlan, parts: list[ShadedPart]) -> bytes:
    coder = coder_of(plan)
    assert coder is not None
    return payload_of(coder.coded(parts, QUICK), counts_of(parts))


def payload_of(coded: bytes, counts: list[BatchPart]) -> bytes:
    """Raises ValueError."""
    room = bytearray(sum(part.bytes for part in counts))
    decoded(memoryview(coded), counts, memoryview(room))
    return bytes(room)


def plan_of(
    geometry: Geometry, step: Step = Step.F, zoom: float = 1.0, order: Order = Order.BACK_TO_FRONT
) -> FramePlan:
    scene = plain_scene(view=View(rotation=TURN, zoom=zoom), size=(512, 512), order=order)
    return plan_frame(scene, geometry, step)


@given(data=st.data(), geometry=geometries(), step=st.sampled_from(Step), limit=st.integers(1, 400))
def test_what_a_walk_sends_comes_back(data: st.DataObject, geometry: Geometry, step: Step, limit: int) -> None:
    scene = data.draw(shaded_scenes(geometry, Image(width=200, height=120)))
    plan = plan_frame(scene, geometry, step)
    sub_cubes = [
        SubCube.of_volume(geometry, data.draw(volumes(geometry)), box) for box in data.draw(partitions(geometry))
    ]
    for sub_cube in sub_cubes:
        sub_cube.pack(PLAIN)
    edge = data.draw(st.integers(0, plan.height // TILE_SIDE)) * TILE_SIDE
    regions = [Region(1, 0, edge), Region(1, edge, plan.height), Region(2, plan.height, plan.height)]
    walk = FrameWalk(sub_cubes, Drawing.of(scene, plan, geometry, PLAIN), None, regions)
    for batch in all_batches(walk, max_packets=limit):
        assert there_and_back(plan, parts_of(batch)) == raw_bytes(parts_of(batch))


@st.composite
def samples_of(draw: st.DrawFn, plan: FramePlan) -> list[Sample]:
    """In order, with gaps of all lengths."""
    counts = [plan.visits[axis].count for axis in plan.traversal.axes]
    ordinals = st.tuples(*(st.integers(0, count - 1) for count in counts))
    starts = draw(st.lists(ordinals, max_size=6))
    lengths = st.lists(st.sampled_from((1, 1, 1, 2, 7, 127, 128, 255, 256, 257, 600)), max_size=40)
    chosen = {start for start in starts}
    for sheet, row, number in starts:
        for step in draw(lengths):
            number += step
            if number < counts[2]:
                chosen.add((sheet, row, number))
    opacity, level = st.integers(0, OPACITY_CODES - 1), st.integers(0, 255)
    shades = draw(st.lists(st.tuples(opacity, level, level, level), min_size=1, max_size=20))
    return [
        Sample(place, shades[n % len(shades)][0], shades[n % len(shades)][1:]) for n, place in enumerate(sorted(chosen))
    ]


@given(
    data=st.data(),
    zoom=st.sampled_from((0.25, 0.5, 1.0, 3.7)),
    order=st.sampled_from(list(Order)[:2]),
    step=st.sampled_from((Step.A, Step.B, Step.F)),
)
def test_any_samples_of_a_plan_come_back(data: st.DataObject, zoom: float, order: Order, step: Step) -> None:
    scene = plain_scene(
        view=View(rotation=TURN, zoom=zoom), order=order, bounds=Bounds(low=(1, 0, 5), high=(3, 5, 3990))
    )
    plan = plan_frame(scene, LONG, step)
    parts = [placed(data.draw(samples_of(plan)), plan) for _ in range(data.draw(st.integers(1, 4)))]
    assert there_and_back(plan, parts) == raw_bytes(parts)


def test_every_opacity_there_is_in_one_batch_comes_back() -> None:
    plan = plan_of(Geometry((1, 2, OPACITY_CODES)))
    samples = [
        Sample((0, row, n), (n * 7 + row) % OPACITY_CODES, (n & 255, n >> 4, 255 - row))
        for row in range(2)
        for n in range(OPACITY_CODES)
    ]
    axes = sorted(plan.traversal.axes, key=lambda axis: plan.visits[axis].count)
    assert plan.traversal.axes == (*axes[:2], 2)
    part = placed(samples, plan)
    assert there_and_back(plan, [part]) == raw_bytes([part])


def test_a_batch_of_nothing_comes_back() -> None:
    nothing = part_of(b"", b"")
    assert there_and_back(plan_of(LONG), [nothing, nothing]) == b""


def dense_part(plan: FramePlan) -> ShadedPart:
    counts = [plan.visits[axis].count for axis in plan.traversal.axes]
    samples = [
        Sample((sheet, row, number), 1 + number % 300, (row, number % 256, 7))
        for sheet in range(min(counts[0], 2))
        for row in range(min(counts[1], 3))
        for number in range(0, min(counts[2], 900), 1 + row)
    ]
    return placed(samples, plan)


def test_a_code_is_never_larger_than_is_said_and_coded_it_is_less_than_half() -> None:
    plan = plan_of(LONG)
    part = dense_part(plan)
    assert len(code_of(plan, [part])) <= largest_code(part.run_count, part.packet_count)
    for level in (QUICK, CLOSE):
        assert len(BatchCoder(plan).coded([part], level)) < len(raw_bytes([part])) / 2


def test_voxels_are_coded_in_less_than_half_and_a_code_of_other_counts_is_refused() -> None:
    plan = plan_of(Geometry((24, 24, 24)), Step.G, zoom=2.0)
    sub_cube = SubCube.of_volume(Geometry((24, 24, 24)), torch.rand((24, 24, 24)))
    sub_cube.pack(PLAIN)
    drawing = Drawing.of(plain_scene(), plan, Geometry((24, 24, 24)), PLAIN)
    batch = all_batches(FrameWalk([sub_cube], drawing))[0]
    part = max(parts_of(batch), key=lambda part: part.packet_count)
    assert part.packet_count > 1000
    for level in (QUICK, CLOSE):
        coded = VoxelBatchCoder().coded([part], level)
        assert len(coded) < len(raw_bytes([part])) / 2
        assert payload_of(coded, counts_of([part])) == raw_bytes([part])
        for runs, packets in ((part.run_count + 1, part.packet_count), (part.run_count, part.packet_count - 1)):
            with pytest.raises(ValueError, match="bytes of voxels"):
                payload_of(coded, [BatchPart(runs, packets)])


def test_what_is_not_on_the_plans_lattice_is_not_coded() -> None:
    plan, other = plan_of(LONG), plan_of(LONG, zoom=1.01)
    with pytest.raises(ValueError, match="lattice"):
        code_of(other, [dense_part(plan)])


def test_counts_that_do_not_agree_are_not_coded() -> None:
    plan = plan_of(LONG)
    part = dense_part(plan)
    with pytest.raises(ValueError, match="packets"):
        code_of(plan, [part_of(bytes(part.runs), bytes(part.packets[:-8]))])
    with pytest.raises(ValueError, match="packets"):
        code_of(plan, [part_of(bytes(part.runs[:-24]), bytes(part.packets))])


def test_samples_that_positions_do_not_tell_apart_are_not_coded() -> None:
    with pytest.raises(ValueError, match="apart"):
        BatchCoder(plan_of(Geometry((4, 4, 4)), zoom=1 / 32))


@given(data=st.data())
def test_a_damaged_code_is_refused_or_gives_as_many_bytes(data: st.DataObject) -> None:
    plan = plan_of(Geometry((2, 3, 40)))
    part = dense_part(plan)
    code = bytearray(code_of(plan, [part]))
    for _ in range(data.draw(st.integers(1, 3))):
        code[data.draw(st.integers(0, len(code) - 1))] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        del code[data.draw(st.integers(0, len(code) - 1)) :]
    try:
        payload = bytes_of_code(bytes(code), [(part.run_count, part.packet_count)])
    except ValueError:
        return
    assert len(payload) == len(raw_bytes([part]))


@given(coded=st.binary(max_size=300), runs=st.integers(0, 40), packets=st.integers(0, 200))
def test_noise_is_refused_or_gives_as_many_bytes(coded: bytes, runs: int, packets: int) -> None:
    assume((runs == 0) == (packets == 0) and runs <= packets)
    part = BatchPart(runs, packets)
    for sent in (coded, zstandard.compress(coded)):
        try:
            payload = payload_of(sent, [part])
        except ValueError:
            continue
        assert len(payload) == part.bytes


def test_a_code_that_unpacks_to_more_than_its_counts_allow_is_refused_before_it_takes_the_memory() -> None:
    with pytest.raises(ValueError, match="at most are due"):
        payload_of(zstandard.compress(bytes(1 << 28)), [BatchPart(1, 1)])


LATTICE = sample_lattice(plan_of(LONG))
LAST_ROW = 2 + 7  # of the lattice's numbers
ONE = {"lattice": LATTICE, "palette": [9], "opacities": b"\0", "gaps": b"\0", "colours": b"rgb"}
FAULTS = {
    "has more opacities": {**ONE, "palette": [1] * 4097},
    "more than 12 bits": {**ONE, "palette": [4096]},
    "not in its palette": {**ONE, "opacities": b"\1"},
    "no rows": {**ONE, "lattice": [*LATTICE[:LAST_ROW], -1, *LATTICE[LAST_ROW + 1 :]]},
    "further away": {**ONE, "lattice": [2**62, *LATTICE[1:]]},
    "cut short": {**ONE, "colours": b""},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_field_out_of_its_range_is_refused(fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        bytes_of_code(written_code(*FAULTS[fault].values(), 0, 0, 1), [(1, 1)])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("numbers", "fault"),
    [
        ((0, 0, 0), "or none"),
        ((0, 0, 2), "more packets than there are"),
        ((2**63, 0, 1), "32 bits"),
        ((0, 2**40, 1), "32 bits"),
        ((2**64 - 1, 0, 1), "32 bits"),
        ((0, 0, 1, 0), "behind its end"),
        ((0, 0), "cut short"),
        ((0, 0, 1 << 70), "64 bits"),
    ],
)
def test_numbers_that_no_batch_has_are_refused(numbers: tuple[int, ...], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        bytes_of_code(written_code(*ONE.values(), *numbers), [(1, 1)])  # type: ignore[arg-type]


@pytest.mark.parametrize("gap", [0, 1, 2**31])
def test_a_run_that_is_longer_than_its_offsets_can_say_is_refused(gap: int) -> None:
    code = written_code(LATTICE, [9], b"\0\0", b"\0\xff", b"rgbrgb", 0, 0, 2, gap + 1000)
    with pytest.raises(ValueError, match="longer"):
        bytes_of_code(code, [(1, 2)])


def test_a_gap_that_no_row_has_is_refused() -> None:
    code = written_code(LATTICE, [9], b"\0\0", b"\0\xff", b"rgbrgb", 0, 0, 2, 2**64 - 1)
    with pytest.raises(ValueError, match="32 bits"):
        bytes_of_code(code, [(1, 2)])
