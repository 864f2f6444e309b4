"""A server's clients, one after the other: it dials them, or waits to be dialled; how long it goes without any."""

import errno
import logging
import socket
import time
from collections.abc import Callable

from volsplat.program.departure import LOOKS_AGAIN, Departure
from volsplat.program.server_process import ServerOptions
from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, NobodyListens, PeerLost, RemoteProtocolError
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.waiting import WaitingPort

LONG_PATIENCE = 2.0  # seconds: whoever waits so long should hear what for
SHORT_SECONDS = 5.0  # a client that was lost sooner than that after it was found …
MOST_SHORT = 2  # … so many times in a row has no use for this server
REPEAT_PAUSE_SECONDS = 1.0  # between two looks for a client, where the first was lost or turned this server away

log = logging.getLogger(__name__)


class Clients:
    """Finds them. `serve` is the life of the server."""

    def __init__(self, role: Role, options: ServerOptions) -> None:
        """As `options` say. For the main thread. Raises BadInput where it cannot wait for clients."""
        self._options = options
        self._allocate: Allocate = BufferPool() if role is Role.MAPSHADE_SERVER else new_buffer
        self._port: WaitingPort | None = None
        if options.wait_at is not None:
            self._port = WaitingPort(role, options.wait_at, options.token, self._allocate, options.encryption)
        self._lost = False  # the client before; or nobody came
        self._client: Connection | None = None  # that was found last
        self._departure = Departure()
        self._departure.watch()
        if self._port is not None:
            log.warning("waiting for clients at %s", self._port.address)

    def next(self, hello: Hello) -> Connection:
        """The next client, which hears `hello`. Raises PeerLost where none comes in time."""
        options = self._options
        patience = options.keep if options.resident else options.patience
        if self._port is not None:
            client = self._port.next_client(hello, patience)
        else:
            assert options.connect is not None
            if self._lost and not options.resident and _is_here(options.connect):
                patience = 0.0  # where it was nobody listens any more, or it takes this server at once
            client = connect(
                options.connect,
                hello,
                options.token,
                Role.CLIENT,
                encryption=options.encryption,
                patience=patience,
                allocate=self._allocate,
                report=lambda error: self._tell_why_it_waits(error, patience),
            )
        self._client = client
        self._departure.attend(client)
        return client

    def _tell_why_it_waits(self, error: PeerLost, patience: float) -> None:
        level = logging.WARNING if patience >= LONG_PATIENCE else logging.INFO
        if self._options.resident and isinstance(error, NobodyListens):  # so it is whenever nobody draws
            log.log(level, "no client at %s yet; waiting for one, up to %g s", self._options.connect, patience)
        else:
            log.log(level, "%s; trying again for %g s", error, patience)

    def serve(self, one: Callable[[], bool]) -> None:
        """Serve one client after the other by `one`, which finds it by next(), and returns whether it comes again.

        Ends where a client has ended its session, unless the server is resident; then where none comes; and by SIGTERM
        (see departure), with a line and a status of its own if its client broke the protocol. Raises what says why
        there was none, or why it was lost.
        """
        lost: PeerLost | RemoteProtocolError | None = None
        short, again = 0, False
        told, last_seen = "", time.monotonic()  # a client was there, or this server began
        while True:
            self._client = None
            began = time.monotonic()
            try:
                again = one()
                lost = None
            except (PeerLost, RemoteProtocolError) as error:
                short = short + 1 if time.monotonic() - began < SHORT_SECONDS else 0
                if self._client is None or (short == MOST_SHORT and not self._options.resident):
                    raise lost or error from error
                lost = error
            except BadInput as error:
                if not self._options.resident or (self._client is None and began - last_seen > self._options.keep):
                    raise
                lost = PeerLost(str(error))
            if self._client is not None:
                told, last_seen = "", time.monotonic()
            if lost is not None and self._client is not None and self._client.broken:
                self._departure.tell_breach(lost)  # before SIGTERM ends it without a word, as one that has no client
                told = str(lost)
            self._departure.attend(None)
            if self._departure.begun or (lost is None and not (again or self._options.resident)):
                return
            self._lost = lost is not None
            if lost is not None:
                if str(lost) != told:
                    level = logging.WARNING if self._options.resident else logging.INFO
                    log.log(level, LOOKS_AGAIN, lost)
                told = str(lost)
                time.sleep(max(0.0, began + REPEAT_PAUSE_SECONDS - time.monotonic()))

    def close(self) -> None:
        if self._port is not None:
            self._port.close()


def _is_here(address: Address) -> bool:
    """Whether the address is one of this machine."""
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(address.host, 0, type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, kind, protocol) as trial:
            trial.bind(place)
    except OSError as error:
        return error.errno not in (errno.EADDRNOTAVAIL, None) and not isinstance(error, socket.gaierror)
    return True
