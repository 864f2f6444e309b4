"""News of the merge: the map before the place, no map twice, and no link that does not read holds up another."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

from volsplat.protocol.messages.messages import MergeReached, Message, TilesClosed
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.closed_tiles import tile_map_bytes
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.peer import Peer
from volsplat.splat_server.merge_news import MergeNews, News

SIDE = 64
EMPTY = bytes(tile_map_bytes(SIDE, SIDE))
FULL = b"\xff" * len(EMPTY)


@contextmanager
def links(count: int) -> Iterator[list[tuple[Connection, Connection]]]:
    """Of the splat server, and of the map/shade servers that hear."""
    with ExitStack() as stack:
        pairs = []
        for number in range(count):
            one, other = socket.socketpair()
            near, far = stack.enter_context(Connection(one, "near")), stack.enter_context(Connection(other, "far"))
            near.open(Peer(Role.DATA_LINK, "here", 0, id=number), Role.SPLAT_SERVER, 9)
            far.open(Peer(Role.SPLAT_SERVER, "here", 0, id=9), Role.DATA_LINK, number)
            pairs.append((near, far))
        yield pairs


@pytest.fixture
def teller() -> Iterator[MergeNews]:
    news = MergeNews()
    yield news
    news.close()


def news(sheet: int, tile_map: bytes = EMPTY, frame: int = 1) -> News:
    return News(MergeReached(frame, sheet, 0), TilesClosed(frame, SIDE, 0, SIDE), tile_map)


def heard(link: Connection, count: int) -> list[Message]:
    messages = []
    for _ in range(count):
        received = link.receive()
        assert received is not None
        messages.append(received.message)
    return messages


def test_a_map_comes_before_the_place_and_only_if_it_has_changed(teller: MergeNews) -> None:
    with links(1) as [(near, far)]:
        told: list[Message] = []
        for one, count in [(news(1), 2), (news(2), 1), (news(3, FULL), 2), (news(1, FULL, frame=2), 2)]:
            teller.post(one, [near])
            told += heard(far, count)
    closed, new = TilesClosed(1, SIDE, 0, SIDE), TilesClosed(2, SIDE, 0, SIDE)
    first, second, third, of_next = (MergeReached(*of, 0) for of in [(1, 1), (1, 2), (1, 3), (2, 1)])
    assert told == [closed, first, second, closed, third, new, of_next]


def test_who_does_not_read_holds_nobody_up_and_hears_the_newest_once_he_reads(teller: MergeNews) -> None:
    with links(2) as [(stuck, unread), (near, far)]:
        while stuck.has_room:
            stuck.send(MergeReached(1, 0, 0))
        for sheet in range(1, 20):
            teller.post(news(sheet), [stuck, near])
            while heard(far, 1)[0] != MergeReached(1, sheet, 0):
                continue
        while heard(unread, 1)[0] != MergeReached(1, 19, 0):
            continue


def test_a_link_that_is_closed_is_done_without(teller: MergeNews) -> None:
    with links(2) as [(gone, _), (near, far)]:
        gone.close()
        teller.post(news(1), [gone, near])
        assert heard(far, 2)[-1] == MergeReached(1, 1, 0)
