"""The merge's state machine: any workers, cuts and arrival orders give the one sorted sequence and the same bits."""

import random
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.row_runs import Dot, Run, batch_of, spans_of
from volsplat.protocol.description.scene import Kernel, Order
from volsplat.protocol.rules.packet_layout import OPACITY_CODES
from volsplat.splat_server import merge as merge_module
from volsplat.splat_server._kernels import Ellipse, FootprintTable
from volsplat.splat_server.footprint_table import kernel_projection
from volsplat.splat_server.image_buffer import ImageBuffer
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import (
    BATCH_OVERHEAD,
    BatchArrived,
    BufferedBatch,
    CompleteFrame,
    Event,
    FrameDropped,
    FrameStarted,
    Instruction,
    MarkIncomplete,
    RefuseBatch,
    SplatSpans,
    SplatterReady,
    WorkerLinked,
    WorkerLost,
)

COUNTS = (3, 4, 12)
SIZE = 32
TABLE = FootprintTable(kernel_projection(Kernel.GAUSSIAN, 2.0), Ellipse(1.0, 0.25, 0.0, 0.25, 4.0, 4.0), 4)


class CheckedMerge:
    """A merge whose invariants are checked after every event; splats into an image as it is told."""

    def __init__(self) -> None:
        self.merge = Merge()
        self.image = ImageBuffer(SIZE, SIZE)
        self.packets = 0

    def handle(self, event: Event) -> list[Instruction]:
        instructions = self.merge.handle(event)
        self.merge.validate_state()
        for instruction in instructions:
            if isinstance(instruction, SplatSpans):
                self.image.splat(instruction.spans, TABLE, Order.BACK_TO_FRONT)
                self.packets += instruction.spans.packets
        return instructions


@dataclass(frozen=True)
class Delivery:
    """All runs of a frame in order, and the same divided among workers and cut into batches."""

    runs: list[Run]
    batches: dict[int, list[BufferedBatch]]


@st.composite
def deliveries(draw: st.DrawFn) -> Delivery:
    workers = draw(st.integers(1, 5))
    chance = random.Random(draw(st.integers(0, 1 << 30)))
    runs, owners = [], []
    for sheet in range(COUNTS[0]):
        for row in range(COUNTS[1]):
            first = 0
            while first < COUNTS[2]:
                count = chance.randint(1, COUNTS[2] - first)
                if chance.random() < 0.7:
                    dots = tuple(_dot(chance) for _ in range(count))
                    runs.append(Run(sheet, row, first, dots))
                    owners.append(chance.randrange(workers))
                first += count
    batches = {}
    for worker in range(workers):
        own = [run for run, owner in zip(runs, owners, strict=True) if owner == worker]
        batches[worker] = _cut(own, chance)
    return Delivery(runs, batches)


def _dot(chance: random.Random) -> Dot:
    colour = (chance.randrange(256), chance.randrange(256), chance.randrange(256))
    return Dot(chance.randrange(SIZE * 64), chance.randrange(SIZE * 64), chance.randrange(1, OPACITY_CODES), colour)


def _cut(runs: list[Run], chance: random.Random) -> list[BufferedBatch]:
    """Batches of any size, empty ones among them; `reached` is anything true."""
    batches, at = [], 0
    while at < len(runs):
        size = chance.randint(0, 5)
        taken, at = runs[at : at + size], at + size
        true = [(runs[at - 1].sheet, runs[at - 1].row)] if 0 < at <= len(runs) else [(0, 0)]
        if at < len(runs):
            true.append((runs[at].sheet, runs[at].row))
        batches.append(batch_of(taken, last=at >= len(runs), reached=chance.choice(true)))
    return batches or [batch_of([], last=True, reached=(0, 0))]


def one_sequence(runs: list[Run]) -> memoryview:
    """The image of all runs sorted by their keys."""
    image = ImageBuffer(SIZE, SIZE)
    pinned = spans_of(sorted(runs, key=lambda run: run.key))
    image.splat(pinned.spans, TABLE, Order.BACK_TO_FRONT)
    return image.snapshot()


@given(deliveries(), st.randoms(use_true_random=False))
def test_any_partition_cut_and_arrival_gives_the_same_bits(delivery: Delivery, chance: random.Random) -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(5, tuple(delivery.batches), COUNTS))
    waiting = {worker: list(batches) for worker, batches in delivery.batches.items()}
    instructions: list[Instruction] = []
    while not any(isinstance(instruction, CompleteFrame) for instruction in instructions):
        worker = chance.choice([*waiting, None])
        if worker is not None:
            assert not checked.handle(BatchArrived(worker, 5, waiting[worker].pop(0)))
            if not waiting[worker]:
                del waiting[worker]
        instructions = checked.handle(SplatterReady(5, chance.randint(1, 30)))
    assert checked.packets == sum(len(run.dots) for run in delivery.runs)
    assert checked.image.snapshot() == one_sequence(delivery.runs)
    assert all(checked.merge.buffered_bytes(worker) == 0 for worker in delivery.batches)
    assert checked.merge.running_frame is None


@given(deliveries(), st.randoms(use_true_random=False))
def test_reading_only_where_allowed_never_deadlocks(delivery: Delivery, chance: random.Random) -> None:
    # A budget of one byte: every worker with anything buffered is held back, unless the merge waits for it.
    budget, merge_module.CONNECTION_BUDGET = merge_module.CONNECTION_BUDGET, 1
    try:
        checked = CheckedMerge()
        checked.handle(FrameStarted(1, tuple(delivery.batches), COUNTS))
        waiting = {worker: list(batches) for worker, batches in delivery.batches.items()}
        complete = False
        while not complete:
            readable = [worker for worker in waiting if waiting[worker] and checked.merge.may_read(worker)]
            if readable:
                worker = chance.choice(readable)
                checked.handle(BatchArrived(worker, 1, waiting[worker].pop(0)))
            before = checked.packets
            instructions = checked.handle(SplatterReady(1, 10))
            complete = any(isinstance(instruction, CompleteFrame) for instruction in instructions)
            assert readable or complete or checked.packets > before, "deadlock"
    finally:
        merge_module.CONNECTION_BUDGET = budget
    assert checked.image.snapshot() == one_sequence(delivery.runs)


@given(deliveries(), st.randoms(use_true_random=False))
def test_nothing_of_another_frame_reaches_the_image(delivery: Delivery, chance: random.Random) -> None:
    checked = CheckedMerge()
    workers = tuple(delivery.batches)
    checked.handle(FrameStarted(1, workers, COUNTS))
    stray = batch_of([Run(0, 0, 0, (_dot(chance),))], last=False)
    assert checked.handle(BatchArrived(0, 1, stray)) == []
    early = [(worker, batch) for worker, batches in delivery.batches.items() for batch in batches]
    for worker, batch in early:
        assert checked.handle(BatchArrived(worker, 2, batch)) == []
    assert checked.merge.buffered_bytes(0) > 0
    checked.handle(FrameStarted(2, workers, COUNTS))
    buffered = checked.merge.buffered_bytes(0)
    assert checked.handle(BatchArrived(0, 1, stray)) == []
    assert checked.merge.buffered_bytes(0) == buffered
    assert checked.handle(SplatterReady(1, 100)) == []
    assert CompleteFrame(2) in checked.handle(SplatterReady(2, 1 << 40))
    assert checked.handle(BatchArrived(0, 2, stray)) == []
    assert checked.merge.buffered_bytes(0) == 0
    assert checked.image.snapshot() == one_sequence(delivery.runs)


def run(sheet: int, row: int) -> Run:
    return Run(sheet, row, 0, (Dot(640, 640, 9, (1, 2, 3)),))


def test_a_lost_worker_leaves_the_frame_incomplete_but_not_hanging() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (7, 8), COUNTS))
    checked.handle(BatchArrived(7, 1, batch_of([run(0, 0), run(2, 0)], last=True)))
    checked.handle(BatchArrived(8, 1, batch_of([run(1, 0)])))
    checked.handle(SplatterReady(1, 100))
    assert checked.packets == 2 and checked.merge.waits_for == 8
    checked.handle(WorkerLost(8))
    assert MarkIncomplete(1, (8,)) in checked.handle(SplatterReady(1, 100))
    assert checked.packets == 3


def test_a_worker_lost_after_its_last_batch_is_not_missed() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (7,), COUNTS))
    checked.handle(BatchArrived(7, 1, batch_of([run(0, 0)], last=True)))
    checked.handle(WorkerLost(7))
    assert CompleteFrame(1) in checked.handle(SplatterReady(1, 100))


def test_a_worker_lost_before_the_frame_is_not_waited_for() -> None:
    checked = CheckedMerge()
    checked.handle(WorkerLost(7))
    checked.handle(FrameStarted(1, (7, 8), COUNTS))
    checked.handle(BatchArrived(8, 1, batch_of([], last=True)))
    assert checked.handle(SplatterReady(1, 100)) == [MarkIncomplete(1, (7,))]


def test_a_worker_that_links_again_is_waited_for_from_the_next_frame_on() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (7,), COUNTS))
    checked.handle(WorkerLost(7))
    checked.handle(WorkerLinked(7))
    assert checked.handle(BatchArrived(7, 1, batch_of([run(0, 0)], last=True))) == []
    assert checked.handle(SplatterReady(1, 100)) == [MarkIncomplete(1, (7,))]
    checked.handle(FrameStarted(2, (7,), COUNTS))
    assert checked.merge.waits_for == 7
    checked.handle(BatchArrived(7, 2, batch_of([run(0, 0)], last=True)))
    assert CompleteFrame(2) in checked.handle(SplatterReady(2, 100))
    assert checked.packets == 1


def test_a_frame_without_workers_or_samples_completes() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (), COUNTS))
    assert checked.handle(SplatterReady(1, 1)) == [CompleteFrame(1)]
    checked.handle(FrameStarted(2, (4,), COUNTS))
    checked.handle(BatchArrived(4, 2, batch_of([], last=True)))
    assert CompleteFrame(2) in checked.handle(SplatterReady(2, 1))


def test_an_aborted_frame_lets_go_of_everything() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(3, (1,), COUNTS))
    checked.handle(BatchArrived(1, 3, batch_of([run(0, 0)])))
    checked.handle(BatchArrived(1, 4, batch_of([run(0, 0)])))
    checked.handle(FrameDropped(4))
    assert checked.merge.running_frame is None and checked.merge.buffered_bytes(1) == 0
    assert checked.handle(SplatterReady(3, 100)) == []
    assert checked.handle(BatchArrived(1, 4, batch_of([run(0, 0)]))) == []
    assert checked.merge.buffered_bytes(1) == 0


def test_spans_stay_readable_though_their_frame_is_aborted_before_they_are_splatted() -> None:
    merge = Merge()
    merge.handle(FrameStarted(1, (1,), COUNTS))
    merge.handle(BatchArrived(1, 1, batch_of([run(0, 0)])))
    splat = merge.handle(SplatterReady(1, 100))[0]
    assert isinstance(splat, SplatSpans)
    merge.handle(FrameDropped(1))
    image = ImageBuffer(SIZE, SIZE)
    image.splat(splat.spans, TABLE, Order.BACK_TO_FRONT)
    assert image.snapshot() == one_sequence([run(0, 0)])


def test_a_batch_that_breaks_the_rules_loses_its_worker_only() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (1, 2), COUNTS))
    [refused] = checked.handle(BatchArrived(1, 1, batch_of([run(99, 0)])))
    assert isinstance(refused, RefuseBatch)
    assert refused.fault.startswith("frame 1, worker 1: run 0 at (sheet 99, row 0, sample 0)")
    assert checked.handle(BatchArrived(1, 1, batch_of([run(0, 0)]))) == []
    assert checked.merge.buffered_bytes(1) == 0
    [stranger] = checked.handle(BatchArrived(9, 1, batch_of([run(0, 0)])))
    assert isinstance(stranger, RefuseBatch)
    checked.handle(BatchArrived(2, 1, batch_of([run(0, 0)], last=True)))
    assert MarkIncomplete(1, (1,)) in checked.handle(SplatterReady(1, 100))
    assert checked.packets == 1


def test_frames_only_go_forward() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(2, (1,), COUNTS))
    with pytest.raises(ValueError, match="frame 2 cannot start after frame 2"):
        checked.handle(FrameStarted(2, (1,), COUNTS))
    with pytest.raises(ValueError, match="names a worker twice"):
        checked.handle(FrameStarted(3, (1, 1), COUNTS))


def test_a_worker_is_read_up_to_its_budget_and_the_one_that_is_waited_for_always() -> None:
    checked = CheckedMerge()
    big = batch_of([run(0, 0)])
    checked.handle(FrameStarted(1, (1, 2), COUNTS))
    budget, merge_module.CONNECTION_BUDGET = merge_module.CONNECTION_BUDGET, big.memory.bytes
    try:
        assert checked.merge.may_read(1) and checked.merge.may_read(2)
        checked.handle(BatchArrived(2, 1, batch_of([run(1, 0)])))
        assert checked.merge.waits_for == 1
        assert checked.merge.may_read(1) and not checked.merge.may_read(2)
    finally:
        merge_module.CONNECTION_BUDGET = budget


@pytest.mark.parametrize("begun", [True, False])
def test_a_frame_does_without_a_worker_that_has_gone_on_to_a_newer_one(begun: bool) -> None:
    """Or it would wait for ever, where nobody asks for the newer one."""
    checked = CheckedMerge()
    events: list[Event] = [FrameStarted(1, (1, 2), COUNTS), BatchArrived(1, 2, batch_of([run(0, 0)], last=True))]
    for event in events if begun else reversed(events):
        checked.handle(event)
    checked.handle(BatchArrived(2, 1, batch_of([run(1, 0)], last=True)))
    assert MarkIncomplete(1, (1,)) in checked.handle(SplatterReady(1, 100))
    checked.handle(FrameStarted(2, (1,), COUNTS))
    assert CompleteFrame(2) in checked.handle(SplatterReady(2, 100))


@pytest.mark.parametrize("same_frame", [True, False])
def test_what_comes_too_early_is_bounded_though_it_is_empty(same_frame: bool) -> None:
    """Empty batches of frames that nobody asked for: a worker is held back, or only the newest frame's are kept."""
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (1, 2), COUNTS))
    taken = 0
    while checked.merge.may_read(1) and taken < 5000:
        taken += 1
        checked.handle(BatchArrived(1, 7 if same_frame else 7 + taken, batch_of([])))
    assert checked.merge.buffered_bytes(1) <= merge_module.CONNECTION_BUDGET + BATCH_OVERHEAD
    assert taken == -(-merge_module.CONNECTION_BUDGET // BATCH_OVERHEAD) if same_frame else taken == 5000
    assert same_frame or checked.merge.buffered_bytes(1) == BATCH_OVERHEAD
    assert checked.merge.may_read(2), "others are not held back"
    checked.handle(WorkerLost(1))
    assert checked.merge.buffered_bytes(1) == 0
    checked.handle(BatchArrived(2, 1, batch_of([run(0, 0)], last=True)))
    assert MarkIncomplete(1, (1,)) in checked.handle(SplatterReady(1, 100))


def test_empty_batches_of_the_running_frame_are_let_go_of() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (1,), COUNTS))
    for _ in range(5000):
        checked.handle(BatchArrived(1, 1, batch_of([])))
        if not checked.merge.may_read(1):
            checked.handle(SplatterReady(1, 100))
        assert checked.merge.may_read(1) and checked.merge.waits_for == 1


def test_a_worker_does_not_go_back_to_a_frame_that_it_has_left() -> None:
    checked = CheckedMerge()
    checked.handle(FrameStarted(1, (1, 2), COUNTS))
    checked.handle(BatchArrived(1, 3, batch_of([])))
    [refused] = checked.handle(BatchArrived(1, 1, batch_of([run(0, 0)])))
    assert isinstance(refused, RefuseBatch) and refused.fault == "frame 1, worker 1: it had gone on to frame 3"
    checked.handle(BatchArrived(2, 1, batch_of([], last=True)))
    assert checked.handle(SplatterReady(1, 100)) == [MarkIncomplete(1, (1,))]
