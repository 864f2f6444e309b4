"""The links from the map/shade servers: a thread for each, which hands its batches to the merge.

A thread stops reading while its worker's buffers are full (see merge.Merge.may_read); the socket makes the worker wait.
Only links of workers that the client has invited are taken (see invitations).
"""

import logging
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import handlers, takes
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES
from volsplat.protocol.text.errors import RemoteProtocolError, VolsplatError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.listener import Listener
from volsplat.splat_server._kernels import BatchMemory
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import BatchArrived, BufferedBatch, RefuseBatch, WorkerLinked, WorkerLost

log = logging.getLogger(__name__)

UNREAD_SECONDS = 25.0  # a worker reads at once; one that has not taken what was sent for this long is gone


@dataclass
class _Came:
    """What has come over one link of the newest frame that it carries."""

    frame: int = 0
    batches: int = 0
    nbytes: int = 0

    def count(self, batch: messages.Batch, nbytes: int) -> None:
        """Raises RemoteProtocolError where a batch is missing, comes twice, or belongs to an older frame."""
        if batch.frame < self.frame:
            raise RemoteProtocolError(f"a batch of frame {batch.frame} came after one of frame {self.frame}")
        if batch.frame > self.frame:
            self.frame, self.batches, self.nbytes = batch.frame, 0, 0
        if batch.sequence != self.batches:
            raise RemoteProtocolError(
                f"Batch.sequence is {batch.sequence}, but {self.batches} is due in frame {batch.frame}: a batch is "
                "missing or repeated"
            )
        self.batches += 1
        self.nbytes += nbytes


class DataLinks:
    """Takes links and their batches until it is closed."""

    def __init__(
        self,
        listener: Listener,
        invitations: Invitations,
        merge: Merge,
        changed: threading.Condition,
        on_news: Callable[[], None],
    ) -> None:
        """`changed` guards the merge and all that is here. `on_news` is called within it: the merge may go on."""
        self._listener = listener
        self._invitations = invitations
        self._merge = merge
        self._changed = changed
        self._on_news = on_news
        self._links: dict[int, Connection] = {}  # by worker, the newest of each
        self._came: dict[int, _Came] = {}  # by worker, over its newest link
        self._held_back: defaultdict[int, float] = defaultdict(float)  # seconds since the frame began, by worker
        threading.Thread(target=self._accept, name="accept data links", daemon=True).start()

    def close(self) -> None:
        self._listener.close()
        self._close_links()

    def _close_links(self) -> None:
        with self._changed:
            links = list(self._links.values())
            self._links.clear()
            self._changed.notify_all()  # threads that hold back
        for link in links:
            link.close()

    def begin_frame(self) -> None:
        """Forget for how long workers were held back before."""
        with self._changed:
            self._held_back.clear()

    def received(self, frame: int) -> int:
        """Bytes of the frame's batches."""
        with self._changed:
            return sum(came.nbytes for came in self._came.values() if came.frame == frame)

    def held_back(self) -> dict[int, float]:
        """For how many seconds since the frame began each worker was not read; only those that waited."""
        with self._changed:
            return dict(self._held_back)

    def of_unfinished_workers(self) -> list[Connection]:
        """The links over which batches of the running frame are still to come."""
        with self._changed:
            return [self._links[worker] for worker in self._merge.unfinished if worker in self._links]

    def cut_off(self, refusal: RefuseBatch) -> None:
        """Close the link of a worker that broke the rules; its thread then tells the merge of the loss."""
        with self._changed:
            link = self._links.get(refusal.worker)
        if link is not None:
            self._listener.lines.warn(f"{_broken(link, refusal.fault)}; the connection is closed")
            link.close()
            with self._changed:
                self._changed.notify_all()  # its thread may hold back

    def _accept(self) -> None:
        while (link := self._listener.accept()) is not None:
            link.lose_after(UNREAD_SECONDS)
            if link.peer.id in self._invitations:
                self._take_up(link)
            else:  # the client has thought better of it since the handshake
                link.close()
        self._close_links()  # one may have been taken up while all were closed

    def _take_up(self, link: Connection) -> None:
        """Read from a link, in the place of the one that its worker had before."""
        with self._changed:
            replaced = self._links.get(link.peer.id)
            self._links[link.peer.id], self._came[link.peer.id] = link, _Came()
            self._merge.handle(WorkerLinked(link.peer.id))
            self._changed.notify_all()  # the thread of the one that it replaces may hold back
        if replaced is not None:
            replaced.close()
        receiver = threading.Thread(target=self._serve, args=(link,), name=f"receive from {link.peer}", daemon=True)
        try:
            receiver.start()
        except RuntimeError as error:  # the system has no thread left to give
            self._listener.lines.warn(f"{link} is dropped: {error}")
            self._lose(link)

    def _serve(self, link: Connection) -> None:
        try:
            self._receive(link)
        except RemoteProtocolError as error:
            self._listener.lines.warn(f"{error}; the connection is closed")
        except MemoryError:
            self._listener.lines.warn(f"the memory does not suffice for a batch from {link}; the connection is closed")
        except VolsplatError as error:
            log.info("%s", error)  # the client is told with the frame
        self._lose(link)

    def _lose(self, link: Connection) -> None:
        link.close()
        with self._changed:
            if self._links.get(link.peer.id) is link:  # a worker that has linked anew is not lost
                del self._links[link.peer.id]
                self._merge.handle(WorkerLost(link.peer.id))
                self._on_news()

    def _receive(self, link: Connection) -> None:
        while self._hold_back(link):
            received = link.receive()
            if received is None:
                return
            HANDLERS[type(received.message)].method(self, received.message, link, received.payload)

    def _hold_back(self, link: Connection) -> bool:
        """Wait while the worker's buffers are full. False where the link is out of use."""
        worker = link.peer.id
        with self._changed:
            if not self._merge.may_read(worker):
                began = time.perf_counter()
                self._changed.wait_for(lambda: self._merge.may_read(worker) or not self._in_use(link))
                self._held_back[worker] += time.perf_counter() - began
            return self._in_use(link)

    def _in_use(self, link: Connection) -> bool:
        return self._links.get(link.peer.id) is link and not link.closed

    @takes(messages.Batch)
    def _take(self, message: messages.Batch, link: Connection, payload: memoryview) -> None:
        """Hand a batch to the merge. Raises RemoteProtocolError where it breaks the rules."""
        if len(message.parts) != 1:
            raise _broken(link, f"frame {message.frame}: a batch of {len(message.parts)} parts for one region")
        runs = payload[: message.parts[0].run_count * ROW_RUN_BYTES]
        try:
            memory = BatchMemory(runs, payload[len(runs) :])
        except ValueError as fault:
            raise _broken(link, f"frame {message.frame}: {fault}") from fault
        batch = BufferedBatch(memory, (message.reached_sheet, message.reached_row), message.last)
        with self._changed:
            if not self._in_use(link):
                return
            try:
                self._came[message.worker].count(message, len(payload))
            except RemoteProtocolError as error:
                raise _broken(link, str(error)) from error
            instructions = self._merge.handle(BatchArrived(message.worker, message.frame, batch))
            self._on_news()
        for instruction in instructions:
            if isinstance(instruction, RefuseBatch):
                raise _broken(link, instruction.fault)


HANDLERS = handlers(DataLinks)


def _broken(link: Connection, fault: str) -> RemoteProtocolError:
    return RemoteProtocolError(f"{link} broke the protocol: {fault}")
