"""The connections to the servers of a session, from joining to loss.

One thread receives from each server and another sends to it; what comes of either is an event for the coordinator.
"""

import logging
import secrets
import socket
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from volsplat.client.coordinator.events.events import (
    Event,
    MessageReceived,
    NobodyJoined,
    ServerJoined,
    ServerLost,
    ServerProcessEnded,
    ServersMissing,
    ServingFailed,
)
from volsplat.client.coordinator.server_states import ANOTHER_SECONDS
from volsplat.client.session.links.image_receiver import ImageReceiver
from volsplat.client.session.links.outgoing import Outgoing
from volsplat.client.session.links.process_ends import ProcessEnds
from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.deploy.local import LocalServers, shared_out
from volsplat.deploy.server_command import Program
from volsplat.program.counts import Counts
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.refusals import refusal
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, LocalProtocolError, RemoteProtocolError, VolsplatError
from volsplat.protocol.text.printable import one_line
from volsplat.protocol.wire.accepting import Accepter, IdCounter
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import UNTAKEN, Heartbeat
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.peer import Peer
from volsplat.protocol.wire.tokens import Token

log = logging.getLogger(__name__)

TRACED = (messages.RenderFrame, messages.ReadImage, messages.FrameMapped, messages.FrameFinished, messages.ImageRead)
HEARD_NO_MORE, SENT_NO_MORE = "is heard no more", "is sent nothing more"
FAREWELL_SECONDS = 0.3  # for telling servers that the session is over; those that do not read hear it from their socket


class ServerLink(NamedTuple):
    """To a server that is there."""

    connection: Connection
    outgoing: Outgoing
    images: ImageReceiver | None  # of a splat server


class ServerLinks:
    """Connections to the servers that join at `listen`. `on_event` is called by any thread."""

    def __init__(
        self,
        listen: Address,
        token: Token,
        on_event: Callable[[Event], None],
        newest_frame: Callable[[], int],
        silence: float,
        encryption: Encryption,
        replaces: bool,
        tracer: FrameTracer | None,
        counts: Counts,
    ) -> None:
        """`newest_frame` is the number of the frame that is waited for.

        If somebody else `replaces` servers that are lost, others are waited for until that one calls give_up().
        A server that says nothing for `silence` seconds is lost.
        """
        self._on_event = on_event
        self._replaces = replaces
        self._tracer = tracer
        self._counts = counts
        self._closing = False
        self.session = secrets.token_hex(4)  # as logs name it, of all processes
        self.token = token
        self.encryption = encryption
        self._links: dict[int, ServerLink] = {}  # to those that are there
        self._lock = threading.Lock()  # guards these
        self._came = threading.Condition(self._lock)  # a connection has come
        self._left = threading.Condition(self._lock)  # a connection is gone
        self._allocate = BufferPool()
        self._heartbeat = Heartbeat(silence)
        self._leaving: set[int] = set()  # those who were told to end; each is added by its receiving thread
        numbers = IdCounter()
        self._listener = Listener(
            Role.CLIENT,
            token,
            host=listen.host,
            port=listen.port,
            assign_id=lambda hello: server_id(hello, len(self._links), numbers),
            allocate=self._allocate,
            encryption=encryption,
        )
        self._local = LocalServers(lambda *ended: on_event(ServerProcessEnded(*ended)), silence, encryption)
        self._ends = ProcessEnds(self._local, newest_frame)
        threading.Thread(target=self._accept, name="accept servers", daemon=True).start()

    @property
    def address(self) -> Address:
        """Where servers join."""
        return self._listener.address

    @property
    def process_ids(self) -> list[int]:
        """Of the servers that were started here."""
        return self._local.process_ids

    def start(self, workers: int, splat_servers: int, threads: int, data_root: str | None = None) -> None:
        """Start as many map/shade servers and splat servers on this machine; those of each kind share the threads.

        Map/shade servers read nothing outside of the folder `data_root`, if given.
        """
        held = () if data_root is None else ("--data-root", data_root)
        for program, count, options in (
            (Program.SPLAT_SERVER, splat_servers, ()),
            (Program.MAPSHADE_SERVER, workers, held),
        ):
            for share in shared_out(threads, count):
                self._local.start(program, str(self.address), self.token, share, options)

    def present(self) -> set[str]:
        """How the servers that are there name their processes."""
        with self._lock:
            return {link.connection.peer.name for link in self._links.values()}

    def wait_for_a_loss(self, seconds: float) -> None:
        """Of any server, but no longer than so long."""
        with self._left:
            self._left.wait(seconds)

    @property
    def accepter(self) -> Accepter:
        """Shakes hands with servers that are dialled instead, for `serve`."""
        return self._listener.accepter

    def send(self, server: int, message: messages.Message, *payload: memoryview) -> None:
        """Have it sent; nobody waits for a server that does not read."""
        with self._lock:
            link = self._links.get(server)
        if link is None:  # its loss is on the way as an event
            return
        if link.images is not None and isinstance(message, (messages.RenderFrame, messages.ReadImage)):
            if (news := link.images.news()) is not None:
                link.outgoing.post(news)
        link.outgoing.post(message, *payload)

    def take_leave(self, message: messages.EndSession) -> None:
        """Have all servers hear that the session is over; none is started in the place of one that ends by that."""
        self._local.let_end()
        with self._lock:
            servers = list(self._links)
        for server in servers:
            self.send(server, message)

    def cut_off(self, server: int, cause: str) -> None:
        """Close the connection to a server that does not keep to the protocol."""
        self._listener.lines.warn(f"{cause}; the connection is closed")
        with self._lock:
            link = self._links.get(server)
        if link is not None:
            link.connection.close()

    def go_without(self, cause: str) -> None:
        """Servers do not come: the session begins without them if it can, and they may join later."""
        self._on_event(ServersMissing(cause))

    def give_up(self, cause: str) -> None:
        """Servers do not come, or not again: the session ends if it cannot go on without."""
        self._on_event(ServersMissing(cause, given_up=True))

    def take_no_more(self) -> None:
        """Nobody can join from now on; who leaves is no loss."""
        self._closing = True
        self._listener.close()
        with self._came:
            self._came.notify_all()  # nobody waits for another one

    def close(self) -> None:
        """Close every connection once what was posted is sent, and end every server that was started here."""
        self._heartbeat.close()
        self.take_no_more()
        with self._lock:
            links = list(self._links.values())
        until = time.monotonic() + FAREWELL_SECONDS
        for link in links:
            link.outgoing.flush(until)
        with self._left:  # servers hang up: if this side did, they would not hear that the session is over
            self._left.wait_for(lambda: not self._links, max(0.0, until - time.monotonic()))
            self._left.notify_all()  # nobody need wait for a loss any more
        for link in links:
            link.connection.close()
        self._local.stop()
        self._allocate.let_go()  # whoever has the session may keep it for what it still tells

    def _accept(self) -> None:
        while (connection := self._listener.accept()) is not None:
            receiver = threading.Thread(
                target=self.serve, args=(connection,), name=f"receive from {connection.peer}", daemon=True
            )
            try:
                receiver.start()
            except RuntimeError as error:  # the system has no thread left to give
                self._drop(connection, error)

    def _drop(self, connection: Connection, cause: Exception) -> None:
        self._listener.lines.warn(f"{connection} is dropped: {cause}")
        connection.close()

    def serve(self, connection: Connection, heard: Callable[[], None] = lambda: None) -> None:
        """Take part in the session until this server is lost. `heard` is called whenever it has said something."""
        peer = connection.peer
        self._ends.joined(peer)
        try:
            outgoing = Outgoing(
                connection,
                lambda message, error: self._refuse(peer, message, error),
                lambda error: self._lose_unsent(connection, error),
                lambda message, began: self._note(f"to {_brief(peer)}", message, began),
            )
        except RuntimeError as error:  # likewise
            self._drop(connection, error)
            return
        by_hand = not (self._replaces or self._local.has(peer.name))
        try:
            self._take_in(connection, outgoing, by_hand)
            cause = self._heard_until_lost(connection, heard)
            self._let_go(peer, outgoing, cause)
        except Exception as error:  # in our own code, or in what a script has us call: nobody may wait for this server
            self._tell_fault(connection, HEARD_NO_MORE, error)
            self._forget(peer, outgoing)
            log.exception("%s %s", peer, HEARD_NO_MORE)  # which can fail as well
            return
        if by_hand and not self._closing:
            self._wait_for_another(peer, cause)

    def _take_in(self, connection: Connection, outgoing: Outgoing, by_hand: bool) -> None:
        """A server has joined."""
        peer = connection.peer
        images = ImageReceiver(connection, self._allocate) if peer.role is Role.SPLAT_SERVER else None
        with self._lock:
            self._links[peer.id] = ServerLink(connection, outgoing, images)
            self._came.notify_all()
        outgoing.post(messages.NameSession(self.session))
        self._log("server_joined", f"{peer} has joined", peer)
        data = Address(peer.data_host, peer.data_port)
        elsewhere = peer.name.partition(",")[0] != socket.gethostname()  # a tunnel ends on this machine as well
        joined = ServerJoined(
            peer.id,
            peer.role,
            str(peer),
            peer.host,
            data,
            elsewhere,
            data_anywhere=peer.data_anywhere,
            client_host=connection.local_host,
            process=peer.name,
            by_hand=by_hand,
        )
        self._on_event(joined)
        if self._tracer is not None:
            self._tracer.joined(peer.id, str(peer), outgoing.post)
        if not connection.may_share_memory:  # no network swallows what is sent within a machine
            connection.lose_after(UNTAKEN * self._heartbeat.silence)
        self._heartbeat.keep(connection, lambda: self._heartbeat.silence)

    def _let_go(self, peer: Peer, outgoing: Outgoing, cause: str) -> None:
        """A server is lost."""
        self._forget(peer, outgoing)
        if self._tracer is not None:
            self._tracer.lost(peer.id)
        self._log("server_left", cause, peer)
        if not (self._closing or peer.id in self._leaving):
            self._counts.add("losses", of=str(peer.role))
        self._on_event(ServerLost(peer.id, cause))

    def _forget(self, peer: Peer, outgoing: Outgoing) -> None:
        if peer.id not in self._leaving:  # who leaves ends by itself
            self._local.end(peer.name)
        with self._lock:
            self._links.pop(peer.id, None)
            self._left.notify_all()
        outgoing.end()

    def _wait_for_another(self, lost: Peer, cause: str) -> None:
        """Of its role, if there is none; whoever starts servers by hand, or a network that was cut, takes a while."""
        with self._came:
            came = self._came.wait_for(
                lambda: self._closing or any(link.connection.peer.role is lost.role for link in self._links.values()),
                ANOTHER_SECONDS,
            )
        if not came:
            self._on_event(NobodyJoined(f"{cause}; no other {lost.role} has joined for {ANOTHER_SECONDS:g} s"))

    def _log(self, event: str, line: str, peer: Peer) -> None:
        log.info("%s", line, extra={"event": event, "session": self.session, "server": peer.id})

    def _heard_until_lost(self, connection: Connection, heard: Callable[[], None]) -> str:
        """Make events of all that a server says; returns why it says no more."""
        peer = connection.peer
        try:
            while (received := connection.receive()) is not None:
                at = time.perf_counter()
                heard()
                message, payload = received
                if self._tracer is not None and self._tracer.take(peer.id, message, at):
                    continue
                if isinstance(message, messages.LeaveSession):
                    self._leaving.add(peer.id)
                for lost in self._ends.told(message):
                    self._on_event(lost)
                self._note(f"from {_brief(peer)}", message, at - connection.counters.seconds_in_message, at)
                if isinstance(message, messages.ImageRead):
                    images = self._links[peer.id].images
                    assert images is not None, "a map/shade server sends no image"
                    payload = images.pixels(message, payload)
                    self._note(f"from {_brief(peer)}", message, at, name="decode image")
                self._on_event(MessageReceived(peer.id, message, payload, at))
                del received, payload  # its memory is used again once nobody holds it
        except VolsplatError as error:
            connection.close()
            if isinstance(error, RemoteProtocolError):
                self._listener.lines.warn(f"{error}; the connection is closed")
            return self._ends.cause_of_loss(peer, error)
        except MemoryError:
            connection.close()
            cause = f"the memory does not suffice for what {peer} sends; ask for a smaller image (--size)"
            self._on_event(ServerProcessEnded(cause, peer.name))  # another one would send as much
            return cause
        return "this side closed the connection"

    def _note(
        self, row: str, message: messages.Message, began: float, ended: float | None = None, name: str = ""
    ) -> None:
        """Note what a message about a frame took until now."""
        if self._tracer is not None and isinstance(message, TRACED):
            ended = time.perf_counter() if ended is None else ended
            self._tracer.note(message.frame, row, name or type(message).__name__, began, ended)

    def _refuse(self, peer: Peer, message: messages.Message, error: LocalProtocolError) -> None:
        """Nothing of it went out: as if the server had refused it."""
        self._on_event(MessageReceived(peer.id, refusal(message, error), memoryview(b""), time.perf_counter()))

    def _lose_unsent(self, connection: Connection, error: Exception) -> None:
        if isinstance(error, VolsplatError):
            self._on_event(ServerLost(connection.peer.id, self._ends.cause_of_loss(connection.peer, error)))
            return
        self._tell_fault(connection, SENT_NO_MORE, error)
        log.error("%s %s", connection.peer, SENT_NO_MORE, exc_info=error)

    def _tell_fault(self, connection: Connection, what: str, error: Exception) -> None:
        """Whoever else is at this server finds the connection closed."""
        peer = connection.peer
        self._on_event(ServingFailed(peer.id, f"{peer} {what}: " + one_line(f"{type(error).__name__}: {error}")))
        connection.close()


def _brief(peer: Peer) -> str:
    return f"{peer.role} {peer.id}"


def server_id(hello: Hello, present: int, numbers: IdCounter) -> int:
    """The next number for who joins where so many servers are `present`.

    Raises BadInput for what is no server, and where there are as many as messages can name.
    """
    if hello.role not in (Role.MAPSHADE_SERVER, Role.SPLAT_SERVER):
        raise BadInput(f"a {hello.role} cannot join a client")
    if present >= messages.MAX_SERVERS:
        raise BadInput(f"{messages.MAX_SERVERS} servers have joined already, which is as many as there can be")
    return numbers(hello)
