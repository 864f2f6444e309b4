"""The splat server's end of data links: whose it takes, how long it waits for them, and how much it keeps of them."""

import secrets
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import pytest

from support.patience import wait_until
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.heartbeat import HELD, Heartbeat
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token
from volsplat.splat_server._kernels import Bell
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.worker_links import FRAMES_NOTED, WorkerLinks

KEY = secrets.token_bytes(messages.WORKER_KEY_BYTES)


class Bench:
    """Where workers dial before anybody takes their links."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._token = new_token()
        self.invitations = Invitations(self._token)
        self.listener = Listener(Role.SPLAT_SERVER, self._token, host="127.0.0.2", token_of=self.invitations.token_of)
        stack.callback(self.listener.close)

    def linked(self, worker: int) -> Connection:
        hello, token = new_hello(Role.DATA_LINK, server=worker), self._token.bound_to(KEY)
        return self._stack.enter_context(connect(self.listener.address, hello, token, Role.SPLAT_SERVER, server=1))

    @contextmanager
    def taking(self) -> Iterator[WorkerLinks]:
        heartbeat = Heartbeat()
        with closing(heartbeat), closing(WorkerLinks(self.listener, self.invitations, Bell(), heartbeat)) as links:
            yield links


@pytest.fixture
def bench() -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack)


def test_a_worker_that_is_not_invited_any_more_is_not_taken(bench: Bench) -> None:
    """The client has thought better of it since the worker's handshake."""
    bench.invitations.replace({11: KEY, 12: KEY})
    dropped, _ = bench.linked(11), bench.linked(12)
    bench.invitations.replace({12: KEY})
    with bench.taking() as links:
        wait_until(lambda: 12 in links._links, "is the other one taken")
        assert 11 not in links._links
        with pytest.raises(PeerLost):
            dropped.receive()


def test_a_worker_that_does_not_read_is_waited_for_as_long_as_one_may_hold_its_interpreter(bench: Bench) -> None:
    bench.invitations.replace({11: KEY})
    bench.linked(11)
    with bench.taking() as links:
        wait_until(lambda: links._links, "is it taken")
        limit = links._links[11]._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
        assert limit == 1000 * HELD * links._heartbeat.silence


def test_what_was_done_is_noted_of_the_newest_frames_alone(bench: Bench) -> None:
    with bench.taking() as links:
        links.trace()
        for frame in range(10):
            spans = links.spans(frame)
            assert links.spans(frame) is spans, "of one frame there is one"
            assert len(links._spans) <= FRAMES_NOTED
