"""A port that is crowded drops who is still in the handshake, and nobody else; one that was closed can be had again."""

import re
import socket
import ssl
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack, closing

import pytest

from support.patience import PATIENCE, wait_until
from support.programs.little_memory import no_more_threads
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost, TurnedAway, VolsplatError
from volsplat.protocol.wire.accepting import Accepter
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.calling import call
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.peer import Peer
from volsplat.protocol.wire.port import Port
from volsplat.protocol.wire.tokens import new_token
from volsplat.protocol.wire.waiting import WaitingPort

HOST = "127.0.0.2"  # where there is no Unix socket beside the port
TOKEN = new_token()
NO_THREAD_FOR_IT = "cannot join .*: it rejected this side: .*ulimit -u"


def test_where_it_is_crowded_nobody_is_dropped_who_has_come_in_already() -> None:
    """The oldest has passed its handshake, and is about to be handed out; the one behind it says nothing."""
    came, go_on = list[Connection](), threading.Event()

    def greet(connection: Connection, address: Address) -> None:
        came.append(connection)
        if len(came) == 1:
            connection.open(Peer(Role.MAPSHADE_SERVER, address.host, address.port), Role.CLIENT, 1)
            go_on.wait(PATIENCE)
        else:
            connection.receive()

    with Port(greet, HOST, 0, most_pending=2, encryption=Encryption.NEVER) as port:
        callers = []
        for _ in range(3):
            callers.append(socket.create_connection(port.address))
            wait_until(lambda: len(came) == len(callers), "greeted")
        wait_until(lambda: came[1].closed, "is the one dropped that has said nothing for the longest")
        go_on.set()
        assert port.accept(PATIENCE) is came[0] and not came[0].closed
        came[0].close()
        for caller in callers:
            caller.close()


def test_a_port_can_be_had_again_at_once_though_connections_of_it_have_just_ended() -> None:
    """The system remembers those for minutes that this side has closed first."""
    port = 0
    for _ in range(2):
        with Port(_let_in, HOST, port, encryption=Encryption.NEVER) as listening:
            port = listening.address.port
            with closing(socket.create_connection(listening.address)) as caller:
                accepted = listening.accept(PATIENCE)
                assert accepted is not None
                accepted.close()
                assert caller.recv(1) == b""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to the limit")
@pytest.mark.parametrize("encryption", Encryption)
def test_a_caller_for_whom_there_is_no_thread_hears_so_at_once_and_comes_in_when_there_is_one(
    encryption: Encryption,
) -> None:
    with Listener(Role.SPLAT_SERVER, TOKEN, host=HOST, encryption=encryption) as listener:
        _dial(listener, encryption).close()  # so that what a handshake needs is there
        told = list[PeerLost]()
        with ExitStack() as want:
            want.enter_context(no_more_threads())
            with pytest.raises(PeerLost, match=NO_THREAD_FOR_IT):
                _dial(listener, encryption, patience=0.0)

            def report(error: PeerLost) -> None:
                told.append(error)
                want.close()

            _dial(listener, encryption, report=report).close()
        assert len(told) == 1 and re.search(NO_THREAD_FOR_IT, str(told[0]))
        assert isinstance(told[0], TurnedAway)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to the limit")
@pytest.mark.parametrize(
    "want", [MemoryError(), RuntimeError("no random numbers")], ids=lambda want: type(want).__name__
)
def test_who_cannot_even_be_told_that_there_is_no_thread_is_dropped_and_the_next_one_comes_in(
    want: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    do_handshake = ssl.SSLObject.do_handshake

    def fails(self: ssl.SSLObject) -> None:
        if self.server_side:
            raise want
        do_handshake(self)

    with Listener(Role.SPLAT_SERVER, TOKEN, host=HOST, encryption=Encryption.ALWAYS) as listener:
        _dial(listener, Encryption.ALWAYS).close()
        with monkeypatch.context() as patch, no_more_threads():
            patch.setattr(ssl.SSLObject, "do_handshake", fails)
            with pytest.raises(PeerLost):
                _dial(listener, Encryption.ALWAYS, patience=0.0)
        _dial(listener, Encryption.ALWAYS).close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to the limit")
def test_a_client_that_a_waiting_server_has_no_thread_for_hears_so() -> None:
    token = new_token()
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(HOST, 0), token)) as port:
        accepter, told = Accepter(Role.CLIENT, token), list[VolsplatError]()

        def calls() -> Connection:
            return call(
                port.address,
                "splat server",
                accepter,
                patience=0.0,
                report=lambda _: None,
                given_up=lambda: False,
                failed=told.append,
            )

        with no_more_threads(), pytest.raises(PeerLost, match="cannot take another connection: .*ulimit -u"):
            calls()
        assert [type(error) for error in told] == [TurnedAway], "it may be called again"


def _dial(
    listener: Listener,
    encryption: Encryption,
    patience: float = PATIENCE,
    report: Callable[[PeerLost], None] = lambda _: None,
) -> Connection:
    hello = new_hello(Role.DATA_LINK, server=7)
    return connect(
        listener.address, hello, TOKEN, Role.SPLAT_SERVER, encryption=encryption, patience=patience, report=report
    )


def _let_in(connection: Connection, address: Address) -> None:
    connection.open(Peer(Role.MAPSHADE_SERVER, address.host, address.port), Role.CLIENT, 1)
