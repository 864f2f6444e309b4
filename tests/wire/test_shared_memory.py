"""Blocks of memory that two ends of a connection see: what one fills the other reads, and nobody can break it."""

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from support.patience import PATIENCE
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost, RemoteProtocolError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.descriptors import passing
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.shared_memory import FilledBlocks, ReadBlocks
from volsplat.protocol.wire.tokens import new_token

BLOCK = 1 << 16


def other_end(filled: FilledBlocks) -> ReadBlocks:
    return ReadBlocks(os.dup(filled.descriptor), len(filled), filled.block_bytes)


def test_what_one_fills_the_other_reads_and_gives_back() -> None:
    filled = FilledBlocks(2, BLOCK)
    read = other_end(filled)
    block = filled.free_block()
    assert block is not None
    drawn = memoryview(block)[:5]
    drawn[:] = b"image"
    number = filled.number_of(drawn)
    assert number is not None
    filled.passed(number)
    shown = memoryview(read.taken(number))[:5]
    assert bytes(shown) == b"image" and read.freed() == []
    del block, drawn
    assert filled.number_of(memoryview(b"")) is None
    other = filled.free_block()
    assert other is not None and filled.number_of(memoryview(other)) == 1 - number
    assert filled.free_block() is None  # one is with the other end, one is here
    del shown
    assert read.freed() == [number] and read.freed() == []
    filled.freed([number])
    assert filled.free_block() is not None
    filled.close()


def test_a_block_that_was_passed_twice_is_free_when_both_are() -> None:
    filled = FilledBlocks(1, BLOCK)
    read = other_end(filled)
    filled.passed(0)
    shown = read.taken(0)
    del shown
    freed = read.freed()
    filled.passed(0)  # before it hears of that
    filled.freed(freed)
    assert filled.free_block() is None
    read.taken(0)
    filled.freed(read.freed())
    assert filled.free_block() is not None
    filled.close()


def test_what_is_read_outlives_both_ends() -> None:
    filled = FilledBlocks(1, BLOCK)
    read = other_end(filled)
    block = filled.free_block()
    assert block is not None
    block[:4] = b"stay"
    shown = memoryview(read.taken(0))
    filled.close()
    del filled, read, block
    assert bytes(shown[:4]) == b"stay"


def test_blocks_that_the_other_end_does_not_have_are_not_free() -> None:
    filled = FilledBlocks(2, BLOCK)
    for wrong in ([0], [7]):
        with pytest.raises(RemoteProtocolError, match=rf"^block {wrong[0]} of the shared memory is called free, but"):
            filled.freed(wrong)
    with pytest.raises(RemoteProtocolError, match="^block 2 is named, but the shared memory has 2$"):
        other_end(filled).taken(2)
    filled.close()


def unsealed() -> int:
    descriptor = os.memfd_create("test")
    os.ftruncate(descriptor, BLOCK)
    return descriptor


def short() -> int:
    filled = FilledBlocks(1, BLOCK)
    descriptor = os.dup(filled.descriptor)
    filled.close()
    return descriptor


@pytest.mark.parametrize(
    ("made", "blocks", "block_bytes", "fault"),
    [
        (unsealed, 1, BLOCK, "the shared memory is not sealed"),
        (short, 2, BLOCK, f"the shared memory has {BLOCK} bytes, but {2 * BLOCK} are announced"),
        (short, 64, BLOCK // 64, "the shared memory cannot be read: "),
        (short, 1, 1 << 62, "are announced"),
        (lambda: os.open(os.devnull, os.O_RDWR), 1, BLOCK, "the shared memory cannot be read: "),
    ],
)
def test_memory_that_could_end_its_reader_is_refused(
    made: Callable[[], int], blocks: int, block_bytes: int, fault: str
) -> None:
    descriptor = made()
    with pytest.raises(RemoteProtocolError, match=fault):
        ReadBlocks(descriptor, blocks, block_bytes)
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)


def test_neither_end_can_make_it_shorter() -> None:
    filled = FilledBlocks(1, BLOCK)
    for size in (0, 2 * BLOCK):
        with pytest.raises(PermissionError):
            os.ftruncate(filled.descriptor, size)
    filled.close()


@contextmanager
def control() -> Iterator[tuple[Connection, Connection]]:
    """A splat server's connection: its own end, then the client's, which has asked for images."""
    token = new_token()
    with Listener(Role.CLIENT, token) as listener:
        near = connect(listener.address, new_hello(Role.SPLAT_SERVER, data_port=1), token, Role.CLIENT, patience=0)
        far = listener.accept(timeout=PATIENCE)
        assert far is not None
        with near, far:
            for frame in (1, 2):
                far.send(messages.ReadImage(frame))
                near.receive()
            yield near, far


def image(frame: int, filled: FilledBlocks, first: bool) -> messages.ImageRead:
    shared = messages.SharedPixels(1, 0, len(filled), filled.block_bytes, first)
    return messages.ImageRead(frame, Step.F, True, 0, 0, 2, 2, shared)


def open_descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_a_descriptor_comes_with_the_message_that_announces_it() -> None:
    filled = FilledBlocks(1, BLOCK)
    with control() as (near, far):
        near.send(image(1, filled, first=True), descriptor=filled.descriptor)
        received = far.receive()
        assert received is not None and received.message.brings_memory
        read = ReadBlocks(far.descriptors.take(), 1, filled.block_bytes)
        near.send(image(2, filled, first=False))
        assert far.receive() is not None
        block = filled.free_block()
        assert block is not None
        block[:3] = b"yes"
        assert read.taken(0)[:3] == b"yes"
    filled.close()


def test_a_descriptor_whose_message_never_ends_is_closed() -> None:
    """A peer that is killed in the middle of a message leaves nothing open here."""
    before = open_descriptors()
    near, far = socket.socketpair(socket.AF_UNIX)
    memory = os.memfd_create("test")
    near.sendmsg([b"VSPL"], passing(memory))
    os.close(memory)
    near.close()
    with Connection(far, "the peer") as receiving, pytest.raises(PeerLost):
        receiving.receive()
    assert open_descriptors() == before


@pytest.mark.parametrize(
    ("first", "passed", "fault"), [(False, True, "came with a descriptor"), (True, False, "lacks its descriptor")]
)
def test_a_descriptor_that_is_not_announced_ends_the_connection(first: bool, passed: bool, fault: str) -> None:
    filled = FilledBlocks(1, BLOCK)
    with control() as (near, far):
        before = open_descriptors()
        near.send(image(1, filled, first), descriptor=filled.descriptor if passed else None)
        with pytest.raises(RemoteProtocolError, match=f"ImageRead {fault}"):
            far.receive()
        assert far.closed and open_descriptors() < before  # the connection's own is closed as well
    filled.close()
