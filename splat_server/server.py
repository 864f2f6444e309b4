"""The splat server's loop: merges what map/shade servers send, splats it, and hands out the image at any time.

One thread works: it answers the client, and between two answers it splats a few milliseconds' worth of packets, so
that aborts and requests for the image never wait long. One thread receives from the client, and one from each
map/shade server; each of these stops reading while its connection's buffers are full (see merge.Merge.may_read), and
TCP makes its server wait.
"""

import logging
import threading
import time
from collections import defaultdict, deque

from volsplat.protocol import messages
from volsplat.protocol.connection import Connection
from volsplat.protocol.errors import BadInput, RemoteProtocolError, VolsplatError
from volsplat.protocol.listener import Listener
from volsplat.protocol.packet_layout import ROW_RUN_BYTES
from volsplat.protocol.peak_memory import peak_memory
from volsplat.protocol.scene import Step
from volsplat.splat_server._kernels import BatchMemory
from volsplat.splat_server.frame_assembly import FrameAssembly
from volsplat.splat_server.merge import Batch, BatchArrived, FrameAborted, Merge, RefuseBatch, WorkerLost

log = logging.getLogger(__name__)

PACKETS_AT_ONCE = 32768  # splatted between two looks at the client's requests: some milliseconds


class SplatServer:
    """One client's splat server. `run` returns when the client ends the session or is gone."""

    def __init__(self, client: Connection, data_links: Listener, threads: int) -> None:
        self._client = client
        self._data_links = data_links
        self._threads = threads
        self._changed = threading.Condition()  # guards what follows; notified whenever any of it changes
        self._merge = Merge()
        self._links: dict[int, Connection] = {}  # by worker
        self._requests: deque[messages.Message | None] = deque()  # None: the session is over
        self._news = False  # something arrived that the merge may go on with
        self._received: defaultdict[int, int] = defaultdict(int)  # bytes of each frame
        self._held_back: defaultdict[int, float] = defaultdict(float)  # seconds since the frame began, by worker
        # Touched by the working thread alone.
        self._assembly: FrameAssembly | None = None
        self._drawing = False  # the assembly's frame is not finished
        self._step = Step.A
        self._waiting_seconds = 0.0

    def run(self) -> None:
        """Serve until the client ends the session or is gone."""
        threading.Thread(target=self._receive_requests, name="receive from client", daemon=True).start()
        threading.Thread(target=self._accept_links, name="accept data links", daemon=True).start()
        while True:
            with self._changed:
                self._wait_for_work()
                asked = bool(self._requests)
                request = self._requests.popleft() if asked else None
                self._news = self._news and asked
            if not asked:
                self._splat()
            elif request is None:
                break
            else:
                self._answer(request)
        self._client.close()
        self._data_links.close()

    def _wait_for_work(self) -> None:
        began = time.perf_counter()
        while not self._requests and not (self._drawing and self._news):
            self._changed.wait()
        if self._drawing:
            self._waiting_seconds += time.perf_counter() - began

    def _splat(self) -> None:
        """Splat what is decided, a little at a time; tell the client once the frame is finished."""
        assembly = self._assembly
        assert assembly is not None
        progress = assembly.advance(PACKETS_AT_ONCE)
        with self._changed:
            self._news = self._news or (progress.waits_for is None and not progress.complete)
            self._changed.notify_all()  # buffers were released, or another worker is waited for
        if not progress.complete:
            return
        self._drawing = False
        self._client.send(
            messages.FrameFinished(
                frame=assembly.frame, complete=not progress.lost, lost=list(progress.lost), stats=self._stats(assembly)
            )
        )

    def _stats(self, assembly: FrameAssembly) -> messages.SplatStats:
        with self._changed:
            received, held_back = self._received[assembly.frame], dict(self._held_back)
        return messages.SplatStats(
            packets=assembly.packets,
            bytes=received,
            merge_seconds=assembly.seconds_in_merge,
            splat_seconds=assembly.seconds_in_splat,
            waiting_seconds=self._waiting_seconds,
            held_back_seconds=held_back,
            peak_memory_bytes=peak_memory(),
        )

    # -- the client's requests, on the working thread

    def _answer(self, request: messages.Message) -> None:
        match request:
            case messages.RenderFrame():
                self._begin(request)
            case messages.AbortFrame(frame=frame):
                self._abort(frame)
            case messages.ReadImage(frame=frame):
                self._send_image(frame)

    def _begin(self, request: messages.RenderFrame) -> None:
        with self._changed:
            self._received = defaultdict(int, {f: n for f, n in self._received.items() if f >= request.frame})
            self._held_back.clear()
            self._news = True
        self._waiting_seconds = 0.0
        try:
            self._assembly = FrameAssembly(
                request.scene,
                request.geometry,
                request.step,
                request.frame,
                request.workers,
                image=self._assembly.image if self._assembly is not None else None,
                merge=self._merge,
                lock=self._changed,
                threads=self._threads,
            )
        except (BadInput, ValueError) as error:
            self._client.send(messages.Refused(request="RenderFrame", cause=str(error), frame=request.frame))
            return
        self._step, self._drawing = request.step, True
        for refusal in self._assembly.refused:
            self._cut_off(refusal)

    def _abort(self, frame: int) -> None:
        with self._changed:
            self._merge.handle(FrameAborted(frame))
            self._changed.notify_all()
        if self._assembly is not None and self._assembly.frame <= frame:
            self._drawing = False
        self._client.send(messages.FrameAborted(frame=frame))

    def _send_image(self, frame: int) -> None:
        assembly = self._assembly
        if assembly is None or assembly.frame != frame:
            return  # the client has gone on to another frame
        image = messages.ImageRead(
            frame=frame,
            step=self._step,
            complete=assembly.complete and not assembly.lost,
            width=assembly.plan.width,
            height=assembly.plan.height,
        )
        self._client.send(image, assembly.published())

    # -- threads that receive

    def _receive_requests(self) -> None:
        try:
            while (received := self._client.receive()) is not None:
                if isinstance(received.message, messages.EndSession):
                    break
                self._ask(received.message)
        except VolsplatError as error:
            log.info("the client is gone: %s", error)
        self._ask(None)

    def _ask(self, request: messages.Message | None) -> None:
        with self._changed:
            self._requests.append(request)
            self._changed.notify_all()

    def _accept_links(self) -> None:
        while (link := self._data_links.accept()) is not None:
            threading.Thread(
                target=self._receive_batches, args=(link,), name=f"receive from {link.peer}", daemon=True
            ).start()

    def _receive_batches(self, link: Connection) -> None:
        worker = link.peer.id
        with self._changed:
            self._links[worker] = link
        try:
            while True:
                self._hold_back(worker)
                received = link.receive()
                if received is None:
                    break
                assert isinstance(received.message, messages.Batch)
                self._take(received.message, received.payload)
        except RemoteProtocolError as error:
            log.warning("%s; the connection is closed", error)
        except VolsplatError as error:
            log.info("%s", error)  # the client is told with the frame
        link.close()
        with self._changed:
            del self._links[worker]
            self._merge.handle(WorkerLost(worker))
            self._news = True
            self._changed.notify_all()

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
            self._received[message.frame] += len(payload)
            instructions = self._merge.handle(BatchArrived(message.worker, message.frame, batch))
            self._news = True
            self._changed.notify_all()
        for instruction in instructions:
            if isinstance(instruction, RefuseBatch):
                self._cut_off(instruction)

    def _cut_off(self, refusal: RefuseBatch) -> None:
        """Close the link of a worker that broke the rules; its thread then tells the merge of the loss."""
        log.warning("%s; its connection is closed", refusal.fault)
        with self._changed:
            link = self._links.get(refusal.worker)
        if link is not None:
            link.close()
