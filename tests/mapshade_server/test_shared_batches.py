"""Batches in memory that a splat server of this machine sees: they come whole, and blocks come back or are not used."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.patience import PATIENCE, wait_until
from volsplat.mapshade_server._kernels import put_side_by_side
from volsplat.mapshade_server.links import shared_batches as map_shade
from volsplat.mapshade_server.links.shaded_batch import ShadedPart
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.shared_memory import FilledBlocks
from volsplat.protocol.wire.tokens import new_token
from volsplat.splat_server import shared_batches as splat

PACKETS = map_shade.LEAST_BYTES // SHADED_PACKET_BYTES  # of one run: enough for a block


def part(packets: int, value: int) -> ShadedPart:
    runs = bytes([value]) * ROW_RUN_BYTES
    return ShadedPart(memoryview(runs), memoryview(bytes([value]) * (packets * SHADED_PACKET_BYTES)), 1, packets)


def batch_of(parts: list[ShadedPart], block: int) -> messages.Batch:
    counts = [messages.BatchPart(part.run_count, part.packet_count) for part in parts]
    return messages.Batch(1, 3, 0, 0, 0, counts, 0, 0, False, block)


@contextmanager
def link() -> Iterator[tuple[Connection, Connection]]:
    """A map/shade server's end, and the splat server's."""
    token = new_token()
    with Listener(Role.SPLAT_SERVER, token) as listener:
        hello = new_hello(Role.DATA_LINK, server=3)
        near = connect(listener.address, hello, token, Role.SPLAT_SERVER, server=1)
        far = listener.accept(PATIENCE)
        assert far is not None
        with near, far:
            yield near, far


@contextmanager
def both() -> Iterator[tuple[map_shade.SharedBatches, splat.SharedBatches]]:
    with link() as (near, far):
        filled, read = map_shade.SharedBatches(near), splat.SharedBatches()
        received = far.receive()
        assert received is not None and isinstance(received.message, messages.BlocksShared)
        read.share(received.message, far.descriptors.take())
        yield filled, read


@given(st.lists(st.tuples(st.integers(0, 12), st.integers(1, 3)), max_size=60))
def test_batches_stay_as_they_were_filled_until_nobody_reads_them(steps: list[tuple[int, int]]) -> None:
    """Each step lets one be that is read, if there are as many, and fills another, of several parts."""
    with both() as (filled, read):
        held: list[tuple[memoryview, int]] = []
        for value, (let_go, count) in enumerate(steps):
            if let_go < len(held):
                del held[let_go]
            if (freed := read.news()) is not None:
                filled.freed(freed.freed)
            parts = [part(PACKETS, value)] * count
            block = filled.filled(parts)
            assert block is not None or len(held) > map_shade.BLOCKS - splat.BUNDLE
            if block is not None:
                batch = batch_of(parts, block)
                payload = read.payload(batch, memoryview(b""))
                assert len(payload) == batch.raw_bytes > batch.payload_bytes() == 0
                held.append((payload, value))
            del parts, block
            for payload, written in held:
                assert payload[0] == payload[-1] == written
            payload = memoryview(b"")


def test_what_is_small_or_larger_than_a_block_goes_by_the_socket() -> None:
    with both() as (filled, _):
        assert filled.filled([part(1, 0)]) is None
        assert filled.filled([part(map_shade.BLOCK_BYTES // SHADED_PACKET_BYTES, 0)]) is None
        assert filled.filled([part(PACKETS, 0)]) is not None


def test_all_goes_by_the_socket_where_the_system_shares_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError("no memory is left")

    monkeypatch.setattr(os, "memfd_create", refuse)
    with link() as (near, _):
        shared = map_shade.SharedBatches(near)
        assert shared.filled([part(PACKETS, 0)]) is None
        with pytest.raises(RemoteProtocolError, match="no memory is shared"):
            shared.freed([0])


def test_no_link_leaves_descriptors_open() -> None:
    with both():
        pass
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(20):
        with both() as (filled, read):
            assert filled.filled([part(PACKETS, 0)]) is not None
            assert read.news() is None
        del filled, read
    # Fewer, since those of earlier tests may close meanwhile
    wait_until(lambda: len(os.listdir("/proc/self/fd")) <= before, "without a descriptor of its own")


def test_blocks_that_were_not_passed_are_refused() -> None:
    with both() as (filled, read):
        with pytest.raises(RemoteProtocolError, match="block 2 of the shared memory is called free"):
            filled.freed([2])
        with pytest.raises(RemoteProtocolError, match="block 12 is named, but the shared memory has 12"):
            read.payload(batch_of([part(1, 0)], 12), memoryview(b""))
        with pytest.raises(RemoteProtocolError, match="but no memory is shared"):
            splat.SharedBatches().payload(batch_of([part(1, 0)], 0), memoryview(b""))
        again = FilledBlocks(1, 1)
        with pytest.raises(RemoteProtocolError, match="shared for the second time"):
            read.share(messages.BlocksShared(1, again.block_bytes), again.descriptor)


@pytest.mark.parametrize(("walkers", "blocks"), [(1, map_shade.BLOCKS), (16, 16 * map_shade.WALKERS_BLOCKS)])
def test_many_walkers_have_a_few_blocks_each(walkers: int, blocks: int) -> None:
    """Else most of what they walk would go by the socket."""
    with link() as (near, far):
        shared = map_shade.SharedBatches(near, walkers)
        filled = [shared.filled([part(PACKETS, 0)]) for _ in range(blocks + 1)]
        assert None not in filled[:blocks] and filled[blocks] is None
        received = far.receive()
        assert received is not None and isinstance(received.message, messages.BlocksShared)
        os.close(far.descriptors.take())


@given(st.lists(st.binary(max_size=40), max_size=6), st.integers(0, 8))
def test_memories_lie_side_by_side_where_there_is_room(memories: list[bytes], spare: int) -> None:
    whole = b"".join(memories)
    target = memoryview(bytearray(b"x" * (len(whole) + spare)))
    put_side_by_side([memoryview(memory) for memory in memories], target)
    assert bytes(target) == whole + b"x" * spare
    if whole:
        with pytest.raises(ValueError, match="does not hold"):
            put_side_by_side([memoryview(memory) for memory in memories], target[: len(whole) - 1])
