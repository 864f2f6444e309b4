"""The links from the map/shade servers: a thread for each, which hands its batches to the merge.

A thread stops reading while its worker's buffers are full (see merge.Merge.may_read); the socket makes the worker wait.
"""

import logging
import threading
import time
from collections import defaultdict
from collections.abc import Callable

from volsplat.protocol import messages
from volsplat.protocol.connection import Connection
from volsplat.protocol.errors import RemoteProtocolError, VolsplatError
from volsplat.protocol.listener import Listener
from volsplat.protocol.packet_layout import ROW_RUN_BYTES
from volsplat.splat_server._kernels import BatchMemory
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import Batch, BatchArrived, RefuseBatch, WorkerLinked, WorkerLost

log = logging.getLogger(__name__)

UNREAD_SECONDS = 25.0  # a worker reads at once; one that has not taken what was sent for this long is gone


class DataLinks:
    """Takes links and their batches until it is closed."""

    def __init__(
        self, listener: Listener, merge: Merge, changed: threading.Condition, on_news: Callable[[], None]
    ) -> None:
        """`changed` guards the merge and all that is here. `on_news` is called within it: the merge may go on."""
        self._listener = listener
        self._merge = merge
        self._changed = changed
        self._on_news = on_news
        self._links: dict[int, Connection] = {}  # by worker, the newest of each
        self._newest_frame = 0
        self._next_sequence: defaultdict[tuple[int, int], int] = defaultdict(int)  # by frame and worker
        self._received: defaultdict[int, int] = defaultdict(int)  # bytes of each frame
        self._held_back: defaultdict[int, float] = defaultdict(float)  # seconds since the frame began, by worker
        threading.Thread(target=self._accept, name="accept data links", daemon=True).start()

    def close(self) -> None:
        self._listener.close()
        with self._changed:
            links = list(self._links.values())
        for link in links:
            link.close()

    def begin_frame(self, frame: int) -> None:
        """Forget older frames' counts."""
        with self._changed:
            self._newest_frame = max(self._newest_frame, frame)
            for old in [key for key in self._next_sequence if key[0] < frame]:
                del self._next_sequence[old]
            for old_frame in [received for received in self._received if received < frame]:
                del self._received[old_frame]
            self._held_back.clear()

    def received(self, frame: int) -> int:
        """Bytes of the frame's batches."""
        with self._changed:
            return self._received[frame]

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
        log.warning("%s; its connection is closed", refusal.fault)
        with self._changed:
            link = self._links.get(refusal.worker)
        if link is not None:
            link.close()

    def _accept(self) -> None:
        while (link := self._listener.accept()) is not None:
            link.lose_after(UNREAD_SECONDS)
            with self._changed:
                replaced = self._links.get(link.peer.id)
                self._links[link.peer.id] = link
                self._merge.handle(WorkerLinked(link.peer.id))
            if replaced is not None:
                replaced.close()
            threading.Thread(target=self._serve, args=(link,), name=f"receive from {link.peer}", daemon=True).start()

    def _serve(self, link: Connection) -> None:
        worker = link.peer.id
        try:
            self._receive(link)
        except RemoteProtocolError as error:
            log.warning("%s; the connection is closed", error)
        except MemoryError:
            log.warning("the memory does not suffice for a batch from %s; the connection is closed", link)
        except VolsplatError as error:
            log.info("%s", error)  # the client is told with the frame
        link.close()
        with self._changed:
            if self._links.get(worker) is link:  # a worker that has linked anew is not lost
                del self._links[worker]
                self._merge.handle(WorkerLost(worker))
                self._on_news()

    def _receive(self, link: Connection) -> None:
        while True:
            self._hold_back(link.peer.id)
            received = link.receive()
            if received is None:
                return
            assert isinstance(received.message, messages.Batch)
            self._take(received.message, received.payload)

    def _hold_back(self, worker: int) -> None:
        """Wait while the worker's buffers are full."""
        with self._changed:
            if self._merge.may_read(worker):
                return
            began = time.perf_counter()
            self._changed.wait_for(lambda: self._merge.may_read(worker))
            self._held_back[worker] += time.perf_counter() - began

    def _take(self, message: messages.Batch, payload: memoryview) -> None:
        """Hand a batch to the merge. Raises RemoteProtocolError where it breaks the rules."""
        runs = payload[: message.run_count * ROW_RUN_BYTES]
        try:
            memory = BatchMemory(runs, payload[len(runs) :])
        except ValueError as fault:
            raise RemoteProtocolError(f"frame {message.frame}, worker {message.worker}: {fault}") from fault
        batch = Batch(memory, (message.reached_sheet, message.reached_row), message.last)
        with self._changed:
            self._count(message, len(payload))
            instructions = self._merge.handle(BatchArrived(message.worker, message.frame, batch))
            self._on_news()
        for instruction in instructions:
            if isinstance(instruction, RefuseBatch):
                raise RemoteProtocolError(instruction.fault)

    def _count(self, message: messages.Batch, nbytes: int) -> None:
        """Raises RemoteProtocolError where a batch is missing or comes twice."""
        if message.frame < self._newest_frame:
            return  # the merge discards it
        key = (message.frame, message.worker)
        if message.sequence != self._next_sequence[key]:
            raise RemoteProtocolError(
                f"frame {message.frame}, worker {message.worker}: Batch.sequence is {message.sequence}, but "
                f"{self._next_sequence[key]} is due: a batch is missing or repeated"
            )
        self._next_sequence[key] += 1
        self._received[message.frame] += nbytes
