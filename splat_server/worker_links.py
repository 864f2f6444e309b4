"""The links from the map/shade servers: a thread for each, which hands its batches to the owners of regions.

A thread stops reading while its worker's buffers are full (see _may_read); the socket makes the worker wait.
Only links of workers that the client has invited are taken (see invitations).
"""

import logging
import os
import threading
import time
from collections import defaultdict
from collections.abc import Mapping

from volsplat.program.frame_spans import UNTRACED, FrameSpans, clock
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import handlers, takes
from volsplat.protocol.text.errors import NoThread, RemoteProtocolError, VolsplatError
from volsplat.protocol.text.want_of_threads import CURE
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.heartbeat import HELD, Heartbeat
from volsplat.protocol.wire.listener import Listener
from volsplat.splat_server._kernels import BatchMemory, Bell, ReadBudget, SplatFrame
from volsplat.splat_server.batch_decoder import decoded
from volsplat.splat_server.came_batches import Came
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import (
    BatchArrived,
    BufferedBatch,
    FrameDropped,
    FrameStarted,
    Instruction,
    RefuseBatch,
    WorkerLinked,
    WorkerLost,
    WorkerWentOn,
)

log = logging.getLogger(__name__)

# Bytes buffered of one worker, beyond which its connection is held back: enough to bridge any pause of the network,
# and little enough that a worker hears of closed tiles before it has shaded what lies behind them.
CONNECTION_BUDGET = 8 << 20
# So many times as much may come while its other walkers are awaited; an honest worker keeps them nearer together.
MOST_APART = 8

FRAMES_NOTED = 3  # for traces
LOOK_SECONDS = 1.0  # between two looks of a link that is held back, if nothing is told


class WorkerLinks:
    """Takes links and their batches until it is closed."""

    def __init__(self, listener: Listener, invitations: Invitations, news: Bell, heartbeat: Heartbeat) -> None:
        """`news` rings if `look_at_channels` should be called."""
        self._listener = listener
        self._invitations = invitations
        self._news = news
        self._heartbeat = heartbeat
        self.readable = Bell()  # rings if links that are held back should look
        self._lock = threading.Lock()  # guards what follows
        self._merge = Merge()
        self._links: dict[int, Connection] = {}  # by worker, the newest of each
        self._came: dict[int, Came] = {}  # by worker, over its newest link
        self._budgets: dict[int, ReadBudget] = {}  # by worker
        self._held_back: defaultdict[int, float] = defaultdict(float)  # seconds since the frame began, by worker
        self._traces = False  # whether the client reads clocks, as who wants traces does
        self._spans: dict[int, FrameSpans] = {}  # by frame: batches may come before theirs begins
        self._noting = threading.Lock()  # guards _spans
        self._unserved: Exception | None = None  # why a link has found no thread since the frame began
        self._rooms = BufferPool()  # for batches that come coded
        self._receivers: set[threading.Thread] = set()  # begun by the accepting thread alone
        self._accepting = threading.Thread(target=self._accept, name="accept data links", daemon=True)
        self._accepting.start()

    def close(self) -> None:
        """End all links and threads: one that was in a kernel when the interpreter ends would abort the process."""
        self._listener.close()
        self._accepting.join()
        self._close_links()
        for receiver in self._receivers:
            receiver.join()

    def _close_links(self) -> None:
        with self._lock:
            links, came = list(self._links.values()), list(self._came.values())
            self._links.clear()
            self.readable.ring()
        for link in links:
            link.close()
        for one in came:
            one.let_go()

    def drop_uninvited(self) -> None:
        """Close the links of workers that the client does without: some may be frozen, and never close theirs."""
        with self._lock:
            dropped = [link for worker, link in self._links.items() if worker not in self._invitations]
            self.readable.ring()
        for link in dropped:
            link.close()

    def forget_waits(self) -> None:
        """Forget for how long workers were held back before, and who found no thread."""
        with self._lock:
            self._held_back.clear()
            self._unserved = None

    def start_frame(self, frame: int, workers: Mapping[int, int], into: SplatFrame) -> None:
        """Have the frame's batches pushed `into` it; `workers` tells how many walkers each has."""
        with self._lock:  # what is held goes before all that comes
            refused = carried_out(self._merge.handle(FrameStarted(frame, workers, into)))
            self._follow_merge()
        for refusal in refused:
            self._cut_off(refusal)

    def drop_frame(self, frame: int) -> None:
        """Of this one and all before nothing is pushed any more."""
        with self._lock:
            self._merge.handle(FrameDropped(frame))
            self._follow_merge()

    @property
    def lost(self) -> list[int]:
        """Workers that the running frame must do without."""
        with self._lock:
            return self._merge.lost

    def check_served(self) -> None:
        """Raises RuntimeError where a worker has come since the frame began for whom there was no thread."""
        if self._unserved is not None:
            raise self._unserved

    def trace(self) -> None:
        """From now on note what is done with each frame's batches."""
        self._traces = True

    def spans(self, frame: int) -> FrameSpans:
        """What is done for a frame, if that is noted: of the newest ones."""
        if not self._traces:
            return UNTRACED
        with self._noting:
            while frame not in self._spans and len(self._spans) >= FRAMES_NOTED:
                del self._spans[min(self._spans)]
            return self._spans.setdefault(frame, FrameSpans(frame, wanted=True))

    def received(self, frame: int) -> int:
        """Bytes of the frame's batches."""
        with self._lock:
            return sum(came.nbytes_of(frame) for came in self._came.values())

    def decoding_seconds(self, frame: int) -> float:
        with self._lock:
            return sum(came.decoding_seconds for came in self._came.values() if came.frame == frame)

    def held_back(self) -> dict[int, float]:
        """For how many seconds since the frame began each worker was not read; only those that waited."""
        with self._lock:
            return dict(self._held_back)

    def to_tell_of_merge(self) -> list[Connection]:
        """The links by whose socket batches of the running frame are still to come: channels have news of their own."""
        with self._lock:
            by_socket = {worker: link for worker, link in self._links.items() if self._came[worker].taker is None}
            return [by_socket[worker] for worker in self._merge.unfinished(by_socket.keys())]

    def _follow_merge(self) -> None:
        """The merge has gone on to another frame, or dropped one: so do those who take batches out of channels."""
        for worker, came in self._came.items():
            came.follow(self._merge.part_of(worker), self._traces)

    def look_at_channels(self) -> None:
        """Cut off who broke the rules there, and do without who has gone on to a later frame."""
        refused = []
        with self._lock:
            for worker, link in self._links.items():
                came = self._came[worker]
                if (taker := came.taker) is None or not taker.take_news() or not self._in_use(link):
                    continue
                frame = taker.newest_frame
                if fault := taker.fault:
                    came.fault_told = True
                    refused.append(RefuseBatch(worker, frame, fault))
                if frame > came.frame:
                    came.give_up()  # before its sources end: its other walkers may have sent more of the older frame
                    self._merge.handle(WorkerWentOn(worker, frame))
        for refusal in refused:
            self._cut_off(refusal)

    def note_taken(self, frame: int) -> None:
        """Note when the finished frame's batches were taken out of channels."""
        if self._traces:
            with self._lock:
                taken = [(worker, span) for worker, came in self._came.items() for span in came.spans()]
            for worker, (began, ended) in taken:
                self.spans(frame).note(_row(worker), "take", began, ended)

    def _cut_off(self, refusal: RefuseBatch) -> None:
        """Close the link of a worker that broke the rules; its thread then tells the merge of the loss."""
        with self._lock:
            link = self._links.get(refusal.worker)
        if link is not None:
            self._listener.lines.warn(f"{_broken(link, refusal.fault)}; the connection is closed")
            link.close()
            self.readable.ring()

    def _accept(self) -> None:
        while (link := self._listener.accept()) is not None:
            link.lose_after(HELD * self._heartbeat.silence)  # a worker reads at once
            self._heartbeat.keep(link, None)  # it is held back on purpose, and the client hears it
            if link.peer.id in self._invitations:
                self._take_up(link)
            else:  # the client has thought better of it since the handshake
                link.close()

    def _take_up(self, link: Connection) -> None:
        """Read from a link, in the place of the one that its worker had before."""
        with self._lock:
            replaced, came = self._links.get(link.peer.id), self._came.get(link.peer.id)
            if came is not None:
                came.give_up()
            self._links[link.peer.id], self._came[link.peer.id] = link, Came()
            self._merge.handle(WorkerLinked(link.peer.id))
            self._budgets.setdefault(link.peer.id, ReadBudget(CONNECTION_BUDGET, self.readable))
            self.readable.ring()
        if replaced is not None:
            replaced.close()
        if came is not None:
            came.let_go()
        receiver = threading.Thread(target=self._serve, args=(link,), name=f"receive from {link.peer}", daemon=True)
        self._receivers = {running for running in self._receivers if running.is_alive()}
        try:
            receiver.start()
            self._receivers.add(receiver)
        except RuntimeError as error:  # the system has no thread left to give
            self._leave(link, error)

    def _leave(self, link: Connection, want: RuntimeError) -> None:
        """Do without a worker for whom there is no thread."""
        self._listener.lines.warn(f"{link} is dropped: {CURE}")
        self._unserved = want
        self._lose(link)
        self._news.ring()

    def _serve(self, link: Connection) -> None:
        try:
            self._receive(link)
        except RemoteProtocolError as error:
            self._listener.lines.warn(f"{error}; the connection is closed")
        except NoThread as error:
            self._leave(link, error)
        except MemoryError:
            self._listener.lines.warn(f"the memory does not suffice for a batch from {link}; the connection is closed")
        except VolsplatError as error:
            log.info("%s", error)  # the client is told with the frame
        except Exception:  # whatever it is: nobody else hears this worker
            log.exception("%s is not heard any more", link)
        finally:
            self._lose(link)

    def _lose(self, link: Connection) -> None:
        link.close()
        with self._lock:
            if self._links.get(link.peer.id) is link:  # a worker that has linked anew is not lost
                del self._links[link.peer.id]
                if fault := self._came[link.peer.id].end():
                    self._listener.lines.warn(str(_broken(link, fault)))
                self._merge.handle(WorkerLost(link.peer.id))

    def _receive(self, link: Connection) -> None:
        while self._hold_back(link):
            received = link.receive()
            if received is None:
                return
            if isinstance(received.message, messages.Batch):
                self._note(received.message, "receive", link.counters.seconds_in_message)
            HANDLERS[type(received.message)].method(self, received.message, link, received.payload)

    def _hold_back(self, link: Connection) -> bool:
        """Wait while the worker's buffers are full. False where the link is out of use."""
        worker, began = link.peer.id, time.perf_counter()
        held_back = False
        while True:
            heard = self.readable.rung
            with self._lock:
                if not self._in_use(link):
                    return False
                if self._may_read(link):
                    if held_back:
                        ended = time.perf_counter()
                        self._held_back[worker] += ended - began
                        self.spans(self._came[worker].frame).note(_row(worker), "held back", began, ended)
                    return True
            held_back = True
            self.readable.wait(heard, LOOK_SECONDS)

    def _may_read(self, link: Connection) -> bool:
        """Raises RemoteProtocolError if the worker's walkers are too far apart."""
        budget = self._budgets[link.peer.id]
        if budget.open:
            return True
        if not self._merge.awaits(link.peer.id):
            return False
        if budget.held >= MOST_APART * CONNECTION_BUDGET:
            raise _broken(link, f"{budget.held} bytes came, and none of the walker that is behind the others")
        return True

    def _in_use(self, link: Connection) -> bool:
        return self._links.get(link.peer.id) is link and not link.closed

    @takes(messages.ChannelsShared)
    def _share(self, message: messages.ChannelsShared, link: Connection, _: memoryview) -> None:
        """Have batches taken out of channels. Raises RemoteProtocolError, MemoryError, NoThread."""
        descriptor = link.descriptors.take()
        with self._lock:
            if not self._in_use(link):
                os.close(descriptor)
                return
            came = self._came[link.peer.id]
            came.share(message, descriptor, self._news)
            came.follow(self._merge.part_of(link.peer.id), self._traces)

    @takes(messages.Batch)
    def _take(self, message: messages.Batch, link: Connection, payload: memoryview) -> None:
        """Hand a batch to the owners of regions. Raises RemoteProtocolError where it breaks the rules."""
        with self._lock:
            if not self._in_use(link):
                return
            if self._came[link.peer.id].taker is not None:
                raise _broken(link, "a batch came by the socket, though its channels are shared")
        self._push(message, link, payload)

    def _note(self, batch: messages.Batch, what: str, seconds: float) -> None:
        """Note what was done with a batch for so long until now."""
        now = clock()
        self.spans(batch.frame).note(_row(batch.worker), what, now - seconds, now)

    def _push(self, message: messages.Batch, link: Connection, payload: memoryview) -> None:
        try:
            parts = [(part.run_count, part.packet_count) for part in message.parts]
            payload, decoding_seconds = self._raw(message, payload)
            if decoding_seconds > 0.0:
                self._note(message, "decode", decoding_seconds)
            memory = BatchMemory(payload, parts, self._budgets[message.worker])
        except ValueError as fault:
            raise _broken(link, f"frame {message.frame}: {fault}") from fault
        reached = (message.reached_sheet, message.reached_row)
        batch = BufferedBatch(message.walker, memory, reached, message.last)
        with self._lock:
            if not self._in_use(link):
                return
            try:
                self._came[message.worker].count(message, decoding_seconds)
            except RemoteProtocolError as error:
                raise _broken(link, str(error)) from error
            instructions = self._merge.handle(BatchArrived(message.worker, message.frame, batch))
        for refused in carried_out(instructions):
            raise _broken(link, refused.fault)

    def _raw(self, message: messages.Batch, payload: memoryview) -> tuple[memoryview, float]:
        """The payload as it would have come raw, and the seconds that took. Raises ValueError."""
        if not message.coded_bytes:
            return payload, 0.0
        began = time.perf_counter()
        room = memoryview(self._rooms(message, message.raw_bytes))[: message.raw_bytes]
        decoded(payload, message.parts, room)
        return room, time.perf_counter() - began


def carried_out(instructions: list[Instruction]) -> list[RefuseBatch]:
    """Push batches; those that were refused, now or before. Their workers must be cut off."""
    refused = []
    for instruction in instructions:
        if isinstance(instruction, RefuseBatch):
            refused.append(instruction)
            continue
        try:
            instruction.carry_out()
        except ValueError as fault:
            told = f"frame {instruction.frame}, worker {instruction.worker}: {fault}"
            refused.append(RefuseBatch(instruction.worker, instruction.frame, told))
    return refused


HANDLERS = handlers(WorkerLinks)


def _row(worker: int) -> str:
    return f"from map/shade server {worker}"


def _broken(link: Connection, fault: str) -> RemoteProtocolError:
    return RemoteProtocolError(f"{link} broke the protocol: {fault}")
