"""Calls to those servers of a cluster that wait for clients: each is dialled, and again once it is lost."""

import threading
from collections.abc import Sequence

from volsplat.client.session.links.server_links import ServerLinks
from volsplat.client.session.missing_reasons import MissingReasons
from volsplat.deploy.cluster.state import KnownServer
from volsplat.protocol.text.errors import TurnedAway, VolsplatError
from volsplat.protocol.wire.addresses import Address, parse_address
from volsplat.protocol.wire.calling import call
from volsplat.protocol.wire.connection import Connection

PAUSE_SECONDS = 2.0  # before a server is dialled again that said nothing, or for which patience was no cure
MOST_WORDLESS = 3  # times that one may hang up so before the others are dialled
CALL_SECONDS = 1e9  # a caller tries until it is told to stop


class ClusterCalls:
    """Dials from begin() until it is closed, each server in a thread of its own.

    Every client dials the same server first, and the others once it has that one: no two clients, each with a part of
    the servers, wait for each other.
    """

    def __init__(self, servers: Sequence[KnownServer], links: ServerLinks, reasons: MissingReasons) -> None:
        self._links, self._reasons = links, reasons
        self._closed = threading.Event()
        self._is_our_turn = threading.Event()  # to dial all servers
        waiting = sorted((one for one in servers if one.wait_at), key=lambda one: one.wait_at)
        self._places = [(one.started.name, parse_address(one.wait_at)) for one in waiting]

    def begin(self) -> None:
        for place in self._places:
            target = self._call_first if place is self._places[0] else self._call_in_turn
            threading.Thread(target=target, args=place, name=f"call {place[0]}", daemon=True).start()

    def close(self) -> None:
        self._closed.set()
        self._is_our_turn.set()

    def _call_first(self, name: str, address: Address) -> None:
        try:
            self._call(name, address)
        finally:
            self._is_our_turn.set()

    def _call_in_turn(self, name: str, address: Address) -> None:
        self._is_our_turn.wait()
        self._call(name, address)

    def _call(self, name: str, address: Address) -> None:
        wordless = 0  # times in a row that it has let us in and hung up
        while not self._closed.is_set():
            try:
                connection = self._connected(name, address)
            except VolsplatError as error:
                self._reasons.note(name, str(error))
            else:
                wordless = 0 if self._has_spoken(name, connection) else wordless + 1
                if wordless == MOST_WORDLESS:
                    self._is_our_turn.set()
                if not wordless:
                    continue
            self._closed.wait(PAUSE_SECONDS)

    def _has_spoken(self, name: str, connection: Connection) -> bool:
        """Whether it did so until it was lost. One that two clients dial at the same moment lets both in, and hangs up
        on one without a word."""
        spoken = threading.Event()

        def heard() -> None:
            if not spoken.is_set():
                spoken.set()
                self._reasons.forget(name)
                self._is_our_turn.set()

        self._links.serve(connection, heard)
        return spoken.is_set()

    def _failed(self, error: VolsplatError) -> None:
        """Of a try to dial: only that of the first server counts, since others are dialled once it is our turn."""
        if not isinstance(error, TurnedAway):  # it decides nothing
            self._is_our_turn.set()

    def _connected(self, name: str, address: Address) -> Connection:
        return call(
            address,
            name,
            self._links.accepter,
            encryption=self._links.encryption,
            patience=CALL_SECONDS,
            report=lambda line: self._reasons.note(name, line),
            given_up=self._closed.is_set,
            failed=self._failed,
        )
