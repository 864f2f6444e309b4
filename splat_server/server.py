"""The splat server's loop: merges what map/shade servers send, splats it, and hands out the image at any time.

One thread works: it answers the client, and between two answers it merges a few milliseconds' worth of packets for the
threads that splat, of which it is one (see image_buffer); few such portions are unfinished at a time, so that aborts
and requests for the image never wait long. Others receive from the client, send to it (see outbox), and receive from
the map/shade servers (see data_links).
"""

import threading
import time
from collections import deque

from volsplat.program.available_memory import available_memory
from volsplat.program.peak_memory import peak_memory
from volsplat.program.this_machine import this_machine
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.exchanges import superseded
from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.protocol.messages.refusals import refusal, why_unheard
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.listener import Listener
from volsplat.splat_server.data_links import DataLinks
from volsplat.splat_server.frame_assembly import FrameAssembly, Idle
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import FrameDropped
from volsplat.splat_server.outbox import Outbox
from volsplat.splat_server.tile_news import TileNews

# What is merged between two looks at the client's requests, by whichever is reached first: some milliseconds.
PACKETS_AT_ONCE = 1 << 17
PIXELS_AT_ONCE = 1 << 23

TILE_NEWS_SECONDS = 0.002  # between two maps of closed tiles, and more where they are large
TILE_NEWS_RATE = 100e6  # bytes a second, over all links


def packets_at_once(pixels_per_packet: int) -> int:
    return min(PACKETS_AT_ONCE, max(1, PIXELS_AT_ONCE // pixels_per_packet))


class SplatServer:
    """One client's splat server. `run` returns when the client ends the session."""

    def __init__(self, client: Connection, data_links: Listener, invitations: Invitations, threads: int) -> None:
        """`data_links` takes links by what `invitations` say."""
        self._client = client
        self._invitations = invitations
        self._threads = threads
        self._changed = threading.Condition()  # guards what follows; notified whenever any of it changes
        self._merge = Merge()
        self._requests: deque[messages.Message | None] = deque()  # None: the session is over
        self._news = False  # something arrived that the merge may go on with
        self._over = False
        self._failure: VolsplatError | None = None  # why the session is over, unless the client ended it
        # Touched by the working thread alone.
        self._images_wanted: deque[messages.ReadImage] = deque()  # asked for while another was being sent
        self._assembly: FrameAssembly | None = None
        self._request: messages.RenderFrame | None = None  # the assembly's
        self._drawing = False  # the assembly's frame is not finished
        self._frame_began = 0.0
        self._planning_seconds = 0.0
        self._waiting_seconds = 0.0
        self._answering_seconds = 0.0
        self._hidden_told = 0  # hidden packets when the workers last heard which tiles are closed
        self._next_tile_news = 0.0

        self._data_links = DataLinks(data_links, invitations, self._merge, self._changed, self._note_news)
        self._tile_news = TileNews()
        self._outbox = Outbox(client, image_sent=self._notify, failed=self._end)

    def run(self) -> None:
        """Serve until the client ends the session. Raises VolsplatError where the client is lost."""
        receiver = threading.Thread(target=self._receive_requests, name="receive from client", daemon=True)
        receiver.start()
        try:
            self._work()
        finally:
            self._client.close()
            self._data_links.close()
            self._tile_news.close()
            self._outbox.close()
            receiver.join()
            if self._assembly is not None:
                self._assembly.image.close()
        if self._failure is not None:
            raise self._failure

    def _work(self) -> None:
        while True:
            request: messages.Message | None = None
            with self._changed:
                self._wait_for_work()
                splat = not self._requests and not self._image_may_go()
                if self._requests:
                    request = self._requests.popleft()
                elif self._image_may_go():
                    request = self._images_wanted.popleft()
                else:
                    self._news = False
            if splat:
                self._splat()
            elif request is None:
                return
            else:
                HANDLERS[type(request)].method(self, request)

    def _wait_for_work(self) -> None:
        assembly = self._assembly if self._drawing else None
        idle = Idle(assembly) if assembly is not None else None
        while not self._requests and not self._image_may_go() and not (self._drawing and self._news):
            if assembly is None or not self._may_hide_more(assembly):
                self._changed.wait()
            elif not self._changed.wait(TILE_NEWS_SECONDS):
                self._tell_closed_tiles(assembly)
        if idle is not None:
            self._waiting_seconds += idle.seconds

    def _image_may_go(self) -> bool:
        return bool(self._images_wanted) and not self._outbox.holds_image

    def _splat(self) -> None:
        """Splat what is decided, a little at a time; tell the client once the frame is finished."""
        assembly, request = self._assembly, self._request
        assert assembly is not None and request is not None
        try:
            progress = assembly.advance(packets_at_once(assembly.pixels_per_packet))
        except Exception as error:
            self._refuse_frame(request, error)
            return
        with self._changed:
            self._news = self._news or (progress.waits_for is None and not progress.complete)
            self._changed.notify_all()  # buffers were released, or another worker is waited for
        if not progress.complete:
            self._tell_closed_tiles(assembly)
            return
        self._drawing = False
        self._outbox.post(
            messages.FrameFinished(
                frame=assembly.frame, complete=not progress.lost, lost=list(progress.lost), stats=self._stats(assembly)
            )
        )
        if not progress.lost:
            # Whoever asked for it as it stood gets it finished.
            self._images_wanted = deque([messages.ReadImage(frame=assembly.frame)])

    def _may_hide_more(self, assembly: FrameAssembly) -> bool:
        """Whether more is hidden than the workers know of, or is about to be."""
        return assembly.splatting or assembly.hidden_packets != self._hidden_told

    def _tell_closed_tiles(self, assembly: FrameAssembly) -> None:
        """Have the workers leave out what is hidden. Hidden packets show that more of it is likely to come."""
        now = time.perf_counter()
        if assembly.hidden_packets == self._hidden_told or now < self._next_tile_news:
            return
        links = self._data_links.of_unfinished_workers()
        if not links:
            return
        tile_map = bytes(assembly.image.closed_tiles)
        self._hidden_told = assembly.hidden_packets
        self._next_tile_news = now + max(TILE_NEWS_SECONDS, len(tile_map) * len(links) / TILE_NEWS_RATE)
        plan = assembly.plan
        closed = messages.TilesClosed(frame=assembly.frame, width=plan.width, begin=0, end=plan.height)
        self._tile_news.post(closed, tile_map, links)

    def _stats(self, assembly: FrameAssembly) -> messages.SplatStats:
        return messages.SplatStats(
            packets=assembly.packets,
            hidden_packets=assembly.hidden_packets,
            bytes=self._data_links.received(assembly.frame),
            frame_seconds=time.perf_counter() - self._frame_began,
            planning_seconds=self._planning_seconds,
            merge_seconds=assembly.seconds_in_merge,
            splat_seconds=assembly.seconds_in_splat,
            waiting_seconds=self._waiting_seconds,
            answering_seconds=self._answering_seconds,
            held_back_seconds=self._data_links.held_back(),
            work=[],
            peak_memory_bytes=peak_memory(),
            machine=this_machine(),
        )

    # -- the client's requests, on the working thread

    @takes(messages.DescribeMachine)
    def _describe_machine(self, request: messages.DescribeMachine) -> None:
        described = messages.MachineDescribed(memory_bytes=available_memory(), threads=self._threads)
        self._outbox.post(described)

    @takes(messages.RenderFrame)
    def _render_frame(self, request: messages.RenderFrame) -> None:
        try:
            self._begin(request)
        except Exception as error:
            self._refuse_frame(request, error)

    @takes(messages.AbortFrame)
    def _abort_frame(self, request: messages.AbortFrame) -> None:
        self._abort(request.frame)
        self._outbox.post(messages.FrameAborted(frame=request.frame))

    @takes(messages.ReadImage)
    def _read_image(self, request: messages.ReadImage) -> None:
        if self._outbox.holds_image:
            still_wanted = [wanted for wanted in self._images_wanted if not superseded(wanted, request)]
            self._images_wanted = deque([*still_wanted, request])
            return
        try:
            self._post_image(request.frame)
        except Exception as error:
            self._outbox.post(refusal(request, error))

    def _begin(self, request: messages.RenderFrame) -> None:
        self._frame_began = time.perf_counter()
        self._data_links.begin_frame()
        self._note_news()
        self._waiting_seconds = self._answering_seconds = 0.0
        self._hidden_told = 0
        self._drawing = False
        before, self._assembly = self._assembly, None
        self._assembly = FrameAssembly(
            request.plan,
            request.frame,
            list(request.workers),
            image=before.image if before is not None else None,
            merge=self._merge,
            lock=self._changed,
            threads=self._threads,
        )
        self._request, self._drawing = request, True
        self._planning_seconds = time.perf_counter() - self._frame_began
        for refused in self._assembly.refused:
            self._data_links.cut_off(refused)

    def _refuse_frame(self, request: messages.RenderFrame, error: Exception) -> None:
        self._abort(request.frame)  # its batches are on their way or here
        self._outbox.post(refusal(request, error))

    def _abort(self, frame: int) -> None:
        with self._changed:
            self._merge.handle(FrameDropped(frame))
            self._changed.notify_all()
        if self._assembly is not None and self._assembly.frame <= frame:
            self._assembly.abort()
            self._drawing = False

    def _post_image(self, frame: int) -> None:
        assembly, request = self._assembly, self._request
        if assembly is None or request is None or assembly.frame != frame:
            return  # the client has gone on to another frame
        idle = Idle(assembly)
        width, height = assembly.plan.image_size
        complete = assembly.complete and not assembly.lost
        step = assembly.plan.step
        pixels = assembly.published()
        if (target := self._outbox.images.target(len(pixels))) is not None:
            target[:] = pixels
            pixels = target
        image = messages.ImageRead(frame, step, complete, 0, 0, width, height, messages.RawPixels())
        self._outbox.post_image(image, pixels, request.exact)
        self._answering_seconds += idle.seconds

    # -- what other threads bring

    def _receive_requests(self) -> None:
        try:
            while (received := self._client.receive()) is not None:
                if received.message.ends:
                    break
                if isinstance(received.message, messages.InviteWorkers):  # must not wait behind a frame
                    self._invite(received.message)
                elif isinstance(received.message, messages.ImagesTaken):
                    self._images_taken(received.message)
                else:
                    self._put(received.message)
            self._end()
        except Exception as error:  # whatever it is: nobody else hears the client
            self._end(why_unheard(self._client, error))

    @takes(messages.InviteWorkers)
    def _invite(self, request: messages.InviteWorkers) -> None:
        self._invitations.replace(request.keys)

    @takes(messages.ImagesTaken)
    def _images_taken(self, message: messages.ImagesTaken) -> None:
        self._outbox.images.taken(message)

    def _put(self, request: messages.Message) -> None:
        """Have the working thread answer it in its turn."""
        with self._changed:
            still_wanted = [waiting for waiting in self._requests if not superseded(waiting, request)]
            self._requests = deque([*still_wanted, request])
            self._changed.notify_all()

    def _end(self, failure: VolsplatError | None = None) -> None:
        """The session is over; only the first cause counts."""
        with self._changed:
            if not self._over:
                self._over, self._failure = True, failure
                self._requests.append(None)
                self._changed.notify_all()

    def _note_news(self) -> None:
        with self._changed:
            self._news = True
            self._changed.notify_all()

    def _notify(self) -> None:
        with self._changed:
            self._changed.notify_all()


OWNERS = (SplatServer, DataLinks)
HANDLERS = handlers(SplatServer)
check_handlers(taken_by(Role.SPLAT_SERVER), *OWNERS)
