"""Servers that wait for clients: one client after the other, in whichever order they start, and others are told why."""

import socket
import threading
from contextlib import closing, suppress
from typing import Any

import pytest

from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.messages import EndSession
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost
from volsplat.protocol.wire.accepting import Accepter
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.calling import call
from volsplat.protocol.wire.connection import Connection, ConnectionClosed
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.peer import Peer
from volsplat.protocol.wire.tokens import Token, new_token
from volsplat.protocol.wire.waiting import WaitingPort

TOKEN = new_token()
SERVER = new_hello(Role.SPLAT_SERVER, data_port=7, name="node1, process 5")


def called(
    address: Address, token: Token = TOKEN, patience: float = PATIENCE, said: list[str] | None = None
) -> Connection:
    report = (said if said is not None else []).append
    accepter = Accepter(Role.CLIENT, token)
    return call(address, "node1 splat 1", accepter, patience=patience, report=report, given_up=lambda: False)


def taken(port: WaitingPort) -> "tuple[Connection, Connection]":
    """A client and the server, connected."""
    clients: list[Connection] = []
    caller = threading.Thread(target=lambda: clients.append(called(port.address)))
    caller.start()
    served = port.next_client(SERVER, PATIENCE)
    caller.join()
    return clients[0], served


def test_a_server_serves_one_client_after_the_other() -> None:
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        for _ in range(2):
            client, served = taken(port)
            with client, served:
                assert client.peer.role is Role.SPLAT_SERVER and client.peer.data_port == 7
                assert client.peer.name == "node1, process 5" and served.peer.role is Role.CLIENT
                client.send(EndSession())
                received = served.receive()
                assert received is not None and received.message == EndSession()


def test_a_second_client_is_told_in_one_line_who_is_served() -> None:
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        client, served = taken(port)
        with client, served:
            said: list[str] = []
            with pytest.raises(PeerLost, match="node1 splat 1 at .* serves another client, at 127.0.0.1, since"):
                called(port.address, patience=0.2, said=said)
            assert len(said) <= 1 and "\n" not in "".join(said)


def test_a_client_that_comes_from_where_the_served_one_is_hears_that_it_may_be_its_own_connection() -> None:
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        client, served = taken(port)
        with client, served, pytest.raises(PeerLost, match=r"serves another client, .* \(if that is this one: "):
            called(port.address, patience=0.2)


def test_of_two_clients_that_come_at_once_one_is_served_and_the_other_dials_again() -> None:
    """Both have heard the hello before either is let in. Who came second is not kept for the session after."""
    at_once, clients = threading.Barrier(2), list[Connection]()

    def come(address: Address) -> None:
        def let_in(_: Hello) -> int:
            at_once.wait(PATIENCE)
            return 1

        accepter = Accepter(Role.CLIENT, TOKEN, assign_id=let_in)
        call_once = call(
            address, "node1", accepter, patience=PATIENCE, report=list[str]().append, given_up=lambda: False
        )
        clients.append(call_once)

    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        coming = [threading.Thread(target=come, args=(port.address,)) for _ in range(2)]
        served: list[Connection] = []
        serving = threading.Thread(target=lambda: served.append(port.next_client(SERVER, PATIENCE)))
        serving.start()
        for one in coming:
            one.start()
        for one in (*coming, serving):
            one.join(PATIENCE)
        (server,) = served
        with server:
            for client in clients:
                with suppress(PeerLost):  # of the one that came second
                    client.send(EndSession())
            received = server.receive()
            assert received is not None and received.message == EndSession()
        for client in clients:
            with client, pytest.raises(PeerLost):
                client.receive()
        with pytest.raises(PeerLost, match="no client has come"):
            port.next_client(SERVER, 0.01)


def test_another_token_is_refused_at_once_and_the_server_waits_on() -> None:
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        waiting = threading.Thread(target=lambda: port.next_client(SERVER, PATIENCE).close())
        waiting.start()
        strangers: list[BadInput] = []
        while not strangers:  # until it waits
            try:
                called(port.address, new_token(), patience=0)
            except BadInput as error:
                strangers.append(error)
            except PeerLost:
                continue
        assert "another session token" in str(strangers[0])
        called(port.address).close()
        waiting.join(PATIENCE)
        assert not waiting.is_alive()


def test_a_client_may_start_before_the_server() -> None:
    address, said = Address(LOOPBACK, free_port()), list[str]()
    clients: list[Connection] = []
    caller = threading.Thread(target=lambda: clients.append(called(address, said=said)))
    caller.start()
    while not said:
        assert caller.is_alive()
    assert "nobody listens there" in said[0]
    with closing(WaitingPort(Role.SPLAT_SERVER, address, TOKEN)) as port, port.next_client(SERVER, PATIENCE):
        caller.join()
        clients[0].close()


def test_a_server_waits_no_longer_than_it_is_to() -> None:
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        with pytest.raises(PeerLost, match="no client has come"):
            port.next_client(SERVER, 0.01)


def test_a_server_that_has_stopped_waiting_is_not_ready() -> None:
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        with pytest.raises(PeerLost, match="no client has come"):
            port.next_client(SERVER, 0.01)
        with pytest.raises(PeerLost, match="is not ready yet"):
            called(port.address, patience=0.0)


def test_a_server_waits_on_where_its_client_is_lost_as_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    opened, lost = Connection.open, list[Connection]()

    def lost_at_first(connection: Connection, peer: Peer, *arguments: Any) -> None:
        if peer.role is Role.CLIENT and not lost:
            lost.append(connection)
            raise ConnectionClosed("the client is gone")
        opened(connection, peer, *arguments)

    monkeypatch.setattr(Connection, "open", lost_at_first)
    with closing(WaitingPort(Role.SPLAT_SERVER, Address(LOOPBACK, 0), TOKEN)) as port:
        served: list[Connection] = []
        serving = threading.Thread(target=lambda: served.append(port.next_client(SERVER, PATIENCE)))
        serving.start()
        called(port.address).close()
        wait_until(lambda: lost, "is it lost")
        client = called(port.address)
        serving.join(PATIENCE)
        with client, served[0]:
            client.send(EndSession())
            received = served[0].receive()
            assert received is not None and received.message == EndSession()


def test_a_name_that_only_this_machine_takes_for_its_own_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.1.1", 0))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found)  # as Debian names a machine to itself
    with pytest.raises(
        BadInput, match="the name desk means 127.0.1.1, which no other machine reaches; give an address"
    ):
        WaitingPort(Role.SPLAT_SERVER, Address("desk", 0), TOKEN)
