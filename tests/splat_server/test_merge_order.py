"""What regions merge: order, waiting, release, budgets that cannot deadlock, and batches that break the rules."""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from support.patience import PATIENCE
from support.scenes.owned import Drawing, even_regions, owners, splatted
from support.scenes.row_runs import Dot, Run, batch_bytes
from volsplat.protocol.description.scene import Kernel, Order
from volsplat.protocol.rules.packet_layout import OPACITY_CODES, ROW_RUN
from volsplat.splat_server._kernels import BatchMemory, Bell, Ellipse, FootprintTable, ReadBudget
from volsplat.splat_server.footprint_table import kernel_projection

COUNTS = (4, 5, 100)
SIZE = (32, 32)
TABLE = FootprintTable(kernel_projection(Kernel.GAUSSIAN, 2.0), Ellipse(1.0, 0.25, 0.0, 0.25, 4.0, 4.0), 4)


@dataclass(frozen=True)
class Sent:
    runs: list[Run]
    reached: tuple[int, int]
    last: bool


@dataclass(frozen=True)
class Delivery:
    """All runs of a frame in order, and the same divided among sources and cut into batches."""

    runs: list[Run]
    batches: list[list[Sent]]


@st.composite
def deliveries(draw: st.DrawFn) -> Delivery:
    sources = draw(st.integers(1, 5))
    chance = random.Random(draw(st.integers(0, 1 << 30)))
    by_turns = draw(st.sampled_from((None, 0, 1)))  # of sheets or rows; else by chance
    runs, senders = [], []
    for sheet in range(COUNTS[0]):
        for row in range(COUNTS[1]):
            first = 0
            while first < 12:
                count = chance.randint(1, 12 - first)
                if chance.random() < 0.7:
                    runs.append(Run(sheet, row, first, tuple(_dot(chance) for _ in range(count))))
                    turn = chance.randrange(sources) if by_turns is None else (sheet, row)[by_turns] % sources
                    senders.append(turn)
                first += count
    own = [[run for run, sender in zip(runs, senders, strict=True) if sender == n] for n in range(sources)]
    return Delivery(runs, [_cut(part, chance) for part in own])


def _dot(chance: random.Random) -> Dot:
    colour = (chance.randrange(256), chance.randrange(256), chance.randrange(256))
    return Dot(chance.randrange(32 * 64), chance.randrange(32 * 64), chance.randrange(1, OPACITY_CODES), colour)


def _cut(runs: list[Run], chance: random.Random) -> list[Sent]:
    """Batches of any size, empty ones among them; `reached` is anything true."""
    batches, at = [], 0
    while at < len(runs):
        size = chance.randint(0, 5)
        taken, at = runs[at : at + size], at + size
        true = [(runs[at - 1].sheet, runs[at - 1].row)] if 0 < at <= len(runs) else [(0, 0)]
        if at < len(runs):
            true.append((runs[at].sheet, runs[at].row))
        batches.append(Sent(taken, chance.choice(true), at >= len(runs)))
    return batches or [Sent([], (0, 0), True)]


def one_sequence(runs: list[Run]) -> Tensor:
    return splatted(sorted(runs, key=lambda run: run.key), TABLE, Order.BACK_TO_FRONT, SIZE)


@given(deliveries(), st.randoms(use_true_random=False), st.integers(1, 4), st.sampled_from((1, 20, 1000)))
def test_any_partition_cut_and_arrival_gives_the_same_bits(
    delivery: Delivery, chance: random.Random, regions: int, portion: int
) -> None:
    with owners(2) as made:
        drawing = Drawing.begun(
            made,
            SIZE,
            TABLE,
            regions=even_regions(SIZE[1], regions),
            sources=len(delivery.batches),
            counts=COUNTS,
            portion=portion,
        )
        waiting = {n: list(sent) for n, sent in enumerate(delivery.batches)}
        while waiting:
            source = chance.choice(list(waiting))
            sent = waiting[source].pop(0)
            drawing.push(sent.runs, source, sent.last, sent.reached)
            if not waiting[source]:
                del waiting[source]
        drawing.wait_until_complete()
        assert torch.equal(drawing.pixels(), one_sequence(delivery.runs))
        assert drawing.frame.packets == regions * sum(len(run.dots) for run in delivery.runs)
        assert drawing.budget.held == 0


@given(deliveries(), st.integers(0, 1 << 30), st.integers(1, 3))
def test_reading_only_within_budgets_never_deadlocks(delivery: Delivery, seed: int, regions: int) -> None:
    """Of one byte for each source: it is read only once all that came of it is splatted."""
    chance = random.Random(seed)  # what there is to choose from depends on the threads
    with owners(2) as made:
        sources = len(delivery.batches)
        drawing = Drawing.begun(
            made, SIZE, TABLE, regions=even_regions(SIZE[1], regions), sources=sources, counts=COUNTS
        )
        budgets = [ReadBudget(1, drawing.news) for _ in range(sources)]
        waiting = {n: list(sent) for n, sent in enumerate(delivery.batches)}
        while waiting:
            heard = drawing.news.rung
            readable = [source for source in waiting if budgets[source].open]
            if not readable:
                assert drawing.news.wait(heard, PATIENCE) != heard, "deadlock"
                continue
            source = chance.choice(readable)
            sent = waiting[source].pop(0)
            drawing.budget = budgets[source]
            drawing.push(sent.runs, source, sent.last, sent.reached)
            if not waiting[source]:
                del waiting[source]
        drawing.wait_until_complete()
        assert torch.equal(drawing.pixels(), one_sequence(delivery.runs))


def run(sheet: int, row: int, first: int = 0, count: int = 1) -> Run:
    return Run(sheet, row, first, tuple(Dot(n, 0, 1, (0, 0, 0)) for n in range(count)))


def test_it_waits_only_for_a_source_that_may_still_come_first() -> None:
    with owners() as made:
        drawing = Drawing.begun(made, SIZE, None, sources=2, counts=COUNTS)
        drawing.push([run(1, 0), run(1, 2), run(2, 2)], 0, reached=(2, 2))
        assert drawing.wait_until_all_wait() == [1]
        assert drawing.frame.packets == 0
        drawing.push([], 1, reached=(1, 2))
        while drawing.frame.packets < 2:
            drawing.wait_until_all_wait()
        assert drawing.wait_until_all_wait() == [1] and drawing.frame.packets == 2
        drawing.frame.finish(1)
        while drawing.wait_until_all_wait() != [0]:
            assert not drawing.frame.complete
        assert drawing.frame.packets == 3 and drawing.budget.held == 0
        assert drawing.frame.finished(1) and not drawing.frame.finished(0)
        drawing.frame.finish(0)
        drawing.frame.finish(0)
        drawing.wait_until_complete()
        assert drawing.frame.awaited == []


BROKEN = {
    "is empty": (run(0, 0, 0), ROW_RUN.pack(0, 0, 0, 0, 0, 0), b""),
    "leaves the frame's 4 sheets": (None, ROW_RUN.pack(4, 0, 0, 1, 0, 0), bytes(8)),
    "5 rows": (None, ROW_RUN.pack(0, 5, 0, 1, 0, 0), bytes(8)),
    "100 samples": (None, ROW_RUN.pack(0, 0, 99, 2, 0, 0), bytes(16)),
    "with 4294967295 packets leaves": (None, ROW_RUN.pack(0, 0, 0, 2**32 - 1, 0, 0), bytes(8)),
    "but the batch holds 1": (None, ROW_RUN.pack(0, 0, 0, 2, 0, 0), bytes(8)),
    "the runs hold 1 packets, the batch 2": (None, ROW_RUN.pack(0, 0, 0, 1, 0, 0), bytes(16)),
    "comes too late": (run(2, 0, 5), ROW_RUN.pack(2, 0, 4, 1, 0, 0), bytes(8)),
    "sample 7": (run(2, 0, 5, 2), ROW_RUN.pack(2, 0, 6, 1, 0, 0), bytes(8)),
    "the worker had reached": (
        None,
        ROW_RUN.pack(1, 0, 0, 1, 0, 0) + ROW_RUN.pack(0, 4, 0, 1, 0, 0),
        bytes(16),
    ),
}


@pytest.mark.parametrize("regions", [1, 2])
@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_batch_is_named_and_not_taken(fault: str, regions: int) -> None:
    """Whichever of its parts it is."""
    earlier, runs, packets = BROKEN[fault]
    with owners() as made:
        drawing = Drawing.begun(made, SIZE, None, regions=even_regions(SIZE[1], regions), counts=COUNTS)
        if earlier:
            drawing.push([earlier], reached=(0, 0))
        parts = [(0, 0)] * (regions - 1) + [(len(runs) // 24, len(packets) // 8)]
        broken = BatchMemory(runs + packets, parts, drawing.budget)
        with pytest.raises(ValueError, match=fault):
            drawing.frame.push(0, broken, 0, 0, False)
        drawing.frame.finish(0)
        drawing.wait_until_complete()
        assert drawing.frame.packets == (regions * len(earlier.dots) if earlier else 0)


def test_what_a_source_claims_to_have_reached_binds_it() -> None:
    with owners() as made:
        drawing = Drawing.begun(made, SIZE, None, counts=COUNTS)
        drawing.push([], reached=(2, 3))
        with pytest.raises(ValueError, match="had reached \\(sheet 2, row 3, sample 0\\)"):
            drawing.push([run(2, 2)])
        with pytest.raises(ValueError, match="beyond the frame"):
            drawing.push([], reached=(5, 0))
        with pytest.raises(ValueError, match="has 2 parts, but there are 1 regions"):
            drawing.frame.push(0, BatchMemory(b"", [(0, 0)] * 2, drawing.budget), 3, 0, False)
        drawing.push([], reached=(4, 0), last=True)
        with pytest.raises(ValueError, match="after the worker's last one"):
            drawing.push([], reached=(4, 0), last=True)
        with pytest.raises(ValueError, match="source 1 is not part"):
            drawing.push([], source=1, reached=(4, 0), last=True)
        with pytest.raises(ValueError, match="source -1 is not part"):
            drawing.frame.finish(-1)


def test_cut_memory_is_refused() -> None:
    budget = ReadBudget(1, Bell())
    for payload, part in ((bytes(23), (1, 0)), (bytes(31), (1, 1)), (b"", (2**63, 0)), (bytes(8), (0, 2**61 + 1))):
        with pytest.raises(ValueError, match="longer than"):
            BatchMemory(payload, [part], budget)
    with pytest.raises(ValueError, match="1 bytes of a batch belong to no part"):
        BatchMemory(bytes(33), [(1, 1)], budget)
    assert budget.held == 0


def test_batch_memory_may_be_any_contiguous_memory_and_counts_while_it_lives() -> None:
    runs, packets = batch_bytes([run(0, 0, 0, 3)])
    budget = ReadBudget(100, Bell())
    unaligned = memoryview(bytearray(b"x" + runs + packets))[1:]
    assert struct.unpack("<6i3Q", unaligned)
    for payload in (runs + packets, bytearray(runs + packets), memoryview(runs + packets), unaligned):
        batch = BatchMemory(payload, [(1, 3)], budget)
        assert budget.held > 48 and not budget.open
        del batch
        assert budget.held == 0 and budget.open
