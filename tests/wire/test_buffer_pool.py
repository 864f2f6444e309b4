"""Memory for payloads is used again once nobody holds it, and never before."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from volsplat.protocol.messages import messages
from volsplat.protocol.wire import buffer_pool
from volsplat.protocol.wire.buffer_pool import (
    LEAST_SPARE,
    MOST_SPARE,
    SMALLEST,
    SPARE_BYTES,
    BufferPool,
    most_spare,
    rounded_up,
)
from volsplat.splat_server import _kernels

MESSAGE = messages.AbortFrame(1)


@given(st.lists(st.tuples(st.integers(1, 20_000), st.booleans()), max_size=40))
def test_what_is_held_is_never_handed_out_again(wishes: list[tuple[int, bool]]) -> None:
    pool = BufferPool()
    held: list[tuple[memoryview, int]] = []
    for number, (nbytes, keep) in enumerate(wishes):
        view = memoryview(pool(MESSAGE, nbytes))[:nbytes]
        assert len(view) == nbytes and not view.readonly
        view[:] = bytes([number]) * nbytes
        if keep:
            held.append((view, number))
        del view
    for view, number in held:
        assert bytes(view) == bytes([number]) * len(view)


def test_what_is_let_go_is_used_again() -> None:
    pool = BufferPool()
    first = id(pool(MESSAGE, 5000))
    assert all(id(pool(MESSAGE, nbytes)) == first for nbytes in (5000, 4097, 8192))


@given(st.integers(1, 1 << 40))
def test_a_buffer_is_hardly_longer_than_what_it_holds(nbytes: int) -> None:
    assert nbytes <= rounded_up(nbytes) <= nbytes + max(SMALLEST, nbytes // 4)


@given(st.integers(SMALLEST, 1 << 31))
def test_spare_buffers_are_few_and_hold_few_bytes(length: int) -> None:
    most = most_spare(length)
    assert LEAST_SPARE <= most <= MOST_SPARE
    assert most == LEAST_SPARE or most * length <= SPARE_BYTES


def test_tensors_and_pinned_batches_hold_their_memory() -> None:
    pool = BufferPool()
    image = torch.frombuffer(memoryview(pool(MESSAGE, 4096))[:4096], dtype=torch.float32)
    image.fill_(1.0)
    budget = _kernels.ReadBudget(1, _kernels.Bell())
    batch = _kernels.BatchMemory(memoryview(pool(MESSAGE, 4096))[:80], [(0, 10)], budget)
    later = pool(MESSAGE, 4096)
    later[:] = b"\x02" * len(later)
    assert torch.all(image == 1.0) and budget.held > 80
    kept = len(pool._buffers[4096])
    del image, batch
    _kernels.BatchMemory(b"", [], budget)  # whoever brings a batch lets go of those that are not needed any more
    pool(MESSAGE, 4096)
    assert len(pool._buffers[4096]) == kept == 3


def test_few_buffers_are_kept_spare() -> None:
    pool = BufferPool()
    many = [pool(MESSAGE, 4096) for _ in range(20)]
    del many
    pool(MESSAGE, 4096)
    assert len(pool._buffers[4096]) <= most_spare(4096)


def test_whoever_sends_all_lengths_by_turns_does_not_make_the_pool_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(buffer_pool, "SPARE_OF_OTHERS", 1 << 20)
    pool = BufferPool()
    lengths = sorted({rounded_up(nbytes) for nbytes in range(1, 1 << 19, 4096)})
    held = pool(MESSAGE, 1 << 18)
    for length in [*lengths, *reversed(lengths)]:
        many = [pool(MESSAGE, length) for _ in range(8)]
        assert len({id(one) for one in [*many, held]}) == 9
        del many
        kept = sum(len(one) for buffers in pool._buffers.values() for one in buffers)
        assert kept <= (1 << 20) + 9 * length + len(held)
