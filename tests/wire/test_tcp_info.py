"""What the system tells of a connection: what was taken of what was sent."""

import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial

import pytest

from support.patience import PATIENCE, wait_until
from volsplat.protocol.wire.tcp_info import Delivery, delivery, round_trip

FAMILIES = [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")]


@contextmanager
def connected(family: socket.AddressFamily, host: str) -> Iterator[tuple[socket.socket, socket.socket]]:
    try:
        listener = socket.create_server((host, 0), family=family)
    except OSError:
        pytest.skip("this machine does not speak it")
    with listener, socket.create_connection(listener.getsockname()[:2], PATIENCE) as one:
        other, _ = listener.accept()
        with other:
            yield one, other


def is_taken(connected: socket.socket, count: int) -> bool:
    return delivery(connected).taken >= count


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone tells")
@pytest.mark.parametrize(("family", "host"), FAMILIES)
def test_what_was_taken_rises_by_what_was_sent_whether_or_not_it_is_read(
    family: socket.AddressFamily, host: str
) -> None:
    with connected(family, host) as (one, other):
        taken, back = delivery(one).taken, delivery(other).taken
        for size in (1, 1000, 20_000):
            one.sendall(bytes(size))
            taken += size
            wait_until(partial(is_taken, one, taken), "is it taken")
            assert delivery(one) == Delivery(sends_again=False, taken=taken)
        assert delivery(other).taken == back
        assert 0.0 < round_trip(one) < PATIENCE


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone tells")
@pytest.mark.parametrize(("family", "host"), FAMILIES)
def test_a_peer_that_does_not_read_is_asked_for_room_and_nothing_is_sent_again(
    family: socket.AddressFamily, host: str
) -> None:
    with connected(family, host) as (one, other):
        one.setblocking(False)
        wait_until(lambda: fill(one) > 2, "is it asked, and asked again")
        taken = delivery(one).taken
        wait_until(lambda: delivery(one) == Delivery(sends_again=False, taken=taken), "has it answered")


def fill(connected: socket.socket) -> int:
    """How often the other end was asked for room: tcpi_backoff, which an answer without any lets stand."""
    with suppress(BlockingIOError):
        while connected.send(bytes(4096)):
            pass
    return connected.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 8)[4]


def test_nothing_is_told_of_sockets_that_lose_nothing() -> None:
    one, other = socket.socketpair()
    with one, other:
        one.sendall(b"said")
        assert delivery(one) == Delivery(sends_again=False, taken=0) and round_trip(one) == 0.0
