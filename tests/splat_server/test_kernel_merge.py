"""The kernel's sorted linked list of buffers: order, waiting, release, and batches that break the rules."""

import struct

import pytest

from support.scenes.row_runs import Dot, Run, batch_bytes
from volsplat.protocol.rules.packet_layout import ROW_RUN
from volsplat.splat_server._kernels import BatchMemory, SortedBuffers

COUNTS = (4, 5, 100)
EVERYTHING = 1 << 62


def run(sheet: int, row: int, first: int, count: int = 1) -> Run:
    return Run(sheet, row, first, tuple(Dot(n, 0, 1, (0, 0, 0)) for n in range(count)))


def memory(*runs: Run) -> BatchMemory:
    return BatchMemory(*batch_bytes(runs))


def test_heads_are_taken_in_order_of_sheet_row_and_sample() -> None:
    buffers = SortedBuffers(3, *COUNTS)
    batches = [
        memory(run(0, 1, 5), run(2, 0, 0)),
        memory(run(0, 1, 0), run(0, 1, 9), run(1, 4, 1)),
        memory(run(0, 0, 99), run(1, 4, 0), run(3, 4, 99)),
    ]
    for worker, batch in enumerate(batches):
        buffers.push(worker, 10 + worker, batch, 0, 0, True)
        buffers.validate()
    spans, released, waits_for, complete = buffers.advance(EVERYTHING)
    assert [(batch, first) for batch, first, _, _, _ in spans.entries()] == [
        (12, 0),
        (11, 0),
        (10, 0),
        (11, 1),
        (12, 1),
        (11, 2),
        (10, 1),
        (12, 2),
    ]
    assert spans.packets == 8
    assert sorted(released) == [10, 11, 12]
    assert waits_for == -1 and complete


def test_it_waits_only_for_a_worker_that_may_still_come_first() -> None:
    buffers = SortedBuffers(2, *COUNTS)
    front = memory(run(1, 0, 0), run(1, 2, 0), run(2, 2, 0))
    buffers.push(0, 1, front, 2, 2, False)
    assert buffers.waits_for == 1
    assert buffers.advance(EVERYTHING)[0].packets == 0
    nothing = memory()
    buffers.push(1, 2, nothing, 1, 2, False)  # reached row 2 of sheet 1
    spans, released, waits_for, complete = buffers.advance(EVERYTHING)
    assert spans.packets == 2 and released == [2] and waits_for == 1 and not complete
    buffers.finish(1)
    spans, released, waits_for, complete = buffers.advance(EVERYTHING)
    assert spans.packets == 1 and released == [1] and waits_for == 0 and not complete
    buffers.finish(0)
    assert buffers.complete


def test_it_stops_where_it_was_told_and_goes_on_there() -> None:
    buffers = SortedBuffers(1, *COUNTS)
    batch = memory(run(0, 0, 0, 10), run(0, 1, 0, 10), run(0, 2, 0, 10))
    buffers.push(0, 7, batch, 0, 0, True)
    assert buffers.advance(1)[0].entries() == [(7, 0, 1, 0, 10)]
    assert buffers.advance(11)[0].entries() == [(7, 1, 2, 10, 20)]
    assert buffers.complete


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


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_batch_is_named_and_not_taken(fault: str) -> None:
    earlier, runs, packets = BROKEN[fault]
    buffers = SortedBuffers(1, *COUNTS)
    before = memory(earlier) if earlier else None
    if before:
        buffers.push(0, 1, before, 0, 0, False)
    broken = BatchMemory(runs, packets)
    with pytest.raises(ValueError, match=fault):
        buffers.push(0, 2, broken, 0, 0, False)
    buffers.validate()
    buffers.finish(0)
    spans, released, _, complete = buffers.advance(EVERYTHING)
    assert len(spans) == (1 if earlier else 0) and released == ([1] if earlier else []) and complete


def test_what_a_worker_claims_to_have_reached_binds_it() -> None:
    buffers = SortedBuffers(1, *COUNTS)
    nothing = memory()
    buffers.push(0, 1, nothing, 2, 3, False)
    with pytest.raises(ValueError, match="had reached \\(sheet 2, row 3, sample 0\\)"):
        buffers.push(0, 2, memory(run(2, 2, 0)), 2, 3, False)
    with pytest.raises(ValueError, match="beyond the frame"):
        buffers.push(0, 2, nothing, 5, 0, False)
    buffers.push(0, 3, nothing, 4, 0, True)
    with pytest.raises(ValueError, match="after the worker's last one"):
        buffers.push(0, 4, nothing, 4, 0, True)
    with pytest.raises(ValueError, match="worker 1 is not part"):
        buffers.push(1, 5, nothing, 4, 0, True)
    with pytest.raises(ValueError, match="worker -1 is not part"):
        buffers.finish(-1)


def test_cut_memory_is_refused() -> None:
    with pytest.raises(ValueError, match="24 bytes each, but there are 23"):
        BatchMemory(bytes(23), b"")
    with pytest.raises(ValueError, match="8 bytes each, but there are 9"):
        BatchMemory(b"", bytes(9))


def test_batch_memory_may_be_any_contiguous_memory() -> None:
    runs, packets = batch_bytes([run(0, 0, 0, 3)])
    for form in (bytes, bytearray, memoryview):
        batch = BatchMemory(form(runs), form(packets))
        assert (batch.bytes, batch.run_count, batch.packet_count) == (48, 1, 3)
    unaligned = memoryview(bytearray(b"x" + packets))[1:]
    assert struct.unpack("<3Q", unaligned)
    assert BatchMemory(runs, unaligned).packet_count == 3
