"""The splat server's loop: has what map/shade servers send splatted, and hands out the image at any time.

One thread answers the client. The regions' owners, threads of the kernels, merge and splat meanwhile (see
frame_assembly); others receive from the client, send to it (see outbox), and receive from the map/shade servers (see
worker_links).
"""

import logging
import threading
import time
from collections import deque

from volsplat.program.counts import Counts
from volsplat.program.frame_spans import UNTRACED, clock
from volsplat.program.log_lines import name_session
from volsplat.program.machine_limits import available_memory
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.exchanges import superseded
from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.protocol.messages.refusals import refusal, why_unheard
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.protocol.rules.regions import regions_of
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS, Heartbeat, patience_with_client
from volsplat.protocol.wire.listener import Listener
from volsplat.splat_server._kernels import Bell, Owners
from volsplat.splat_server.frame_assembly import FrameAssembly
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import FrameDropped, FrameStarted
from volsplat.splat_server.merge_news import MergeNews, News
from volsplat.splat_server.outbox import Outbox
from volsplat.splat_server.slabs import slabs_of
from volsplat.splat_server.worker_links import WorkerLinks, carried_out

NEWS_SECONDS = 0.002  # between two news of the merge, and more if maps of closed tiles are large
NEWS_RATE = 100e6  # bytes a second, over all links
LOOK_SECONDS = 1.0  # between two looks at the frame, if nothing is told


log = logging.getLogger(__name__)


class SplatServer:
    """One client's splat server. `run` returns when the client ends the session."""

    def __init__(
        self,
        client: Connection,
        data_links: Listener,
        invitations: Invitations,
        threads: int,
        silence: float = SILENCE_SECONDS,
        counts: Counts | None = None,
    ) -> None:
        """`data_links` takes links by what `invitations` say. What is done is added to `counts`.
        `silence`: see heartbeat."""
        self._client = client
        self._invitations = invitations
        self._threads = threads
        self._counts = counts or Counts()
        self._owners = Owners(threads)
        self._news = Bell()  # rings whenever there is something for the working thread to look at
        self._readable = Bell()  # rings whenever a link that is held back may be read
        self._lock = threading.Lock()  # guards what follows
        self._merge = Merge()
        self._requests: deque[messages.Message | None] = deque()  # None: the session is over
        self._over = False
        self._another = False  # the client ended the session, and begins another one at once
        self._failure: VolsplatError | None = None  # why the session is over, unless the client ended it
        # Touched by the working thread alone.
        self._images_wanted: deque[messages.ReadImage] = deque()  # asked for while another was being sent
        self._assembly: FrameAssembly | None = None
        self._block: memoryview | None = None  # that the client sees, and the assembly's image is published in
        self._request: messages.RenderFrame | None = None  # the assembly's
        self._spans = UNTRACED  # the assembly's
        self._newest_came = 0.0  # when the newest request of a frame did; the receiving thread's
        self._frame_came = 0.0  # when the assembly's did
        self._lost: list[int] = []  # workers that its finished image lacks
        self._drawing = False  # the assembly's frame is not finished
        self._frame_began = 0.0
        self._planning_seconds = 0.0
        self._reached_told = (0, 0)  # sheet and row, when the workers last heard of the merge
        self._next_news = 0.0

        self._heartbeat = Heartbeat(silence)
        self._heartbeat.keep(client, patience_with_client(client, silence))
        self._worker_links = WorkerLinks(
            data_links, invitations, self._merge, self._lock, self._readable, self._news, self._heartbeat
        )
        self._merge_news = MergeNews()
        self._outbox = Outbox(client, image_sent=self._news.ring, failed=self._end)

    def run(self) -> bool:
        """Serve until the client ends the session; returns whether it begins another one at once.

        Raises VolsplatError where the client is lost.
        """
        receiver = threading.Thread(target=self._receive_requests, name="receive from client", daemon=True)
        receiver.start()
        try:
            self._work()
        finally:
            self._client.close()
            self._worker_links.close()
            self._merge_news.close()
            self._outbox.close()
            self._heartbeat.close()
            receiver.join()
            self._owners.close()
        if self._failure is not None:
            raise self._failure
        return self._another

    def _work(self) -> None:
        while True:
            heard = self._news.rung
            if self._requests:
                with self._lock:
                    request = self._requests.popleft()
            elif self._images_wanted and not self._outbox.holds_image:
                request = self._images_wanted.popleft()
            else:
                self._news.wait(heard, self._follow_frame())
                continue
            if request is None:
                return
            HANDLERS[type(request)].method(self, request)

    def _follow_frame(self) -> float:
        """Tell what there is to tell of the frame. For how many seconds there is nothing more, unless news come."""
        assembly, request = self._assembly, self._request
        self._worker_links.look_at_channels()
        if not self._drawing or assembly is None or request is None:
            return LOOK_SECONDS
        try:
            self._worker_links.check_served()
            complete = assembly.splat.complete
        except Exception as error:
            self._refuse_frame(request, error)
            return LOOK_SECONDS
        if complete:
            self._finish_frame(assembly)
            return 0.0
        if not assembly.plan.hides:
            return LOOK_SECONDS
        if (early := self._next_news - time.perf_counter()) > 0:
            return early
        if not (links := self._worker_links.to_tell_of_merge()):
            return LOOK_SECONDS
        if (reached := assembly.splat.reached()) != self._reached_told:
            self._tell_of_merge(assembly, reached, links)
        return LOOK_SECONDS

    def _finish_frame(self, assembly: FrameAssembly) -> None:
        self._drawing = False
        assembly.note_owners(self._spans, self._frame_began)
        self._worker_links.note_taken(assembly.frame)
        self._spans.note("requests", f"frame {assembly.frame}", self._frame_came, clock())
        with self._lock:
            self._lost = self._merge.lost
        stats = self._stats(assembly)
        log.info(
            "frame %d is finished: %d packets in %.3f s",
            assembly.frame,
            stats.packets,
            stats.frame_seconds,
            extra={"event": "frame_finished", "frame": assembly.frame},
        )
        self._count(stats)
        self._outbox.post(
            messages.FrameFinished(frame=assembly.frame, complete=not self._lost, lost=self._lost, stats=stats)
        )
        if not self._lost:
            # Whoever asked for it as it stood gets it finished.
            self._images_wanted = deque([messages.ReadImage(frame=assembly.frame)])

    def _count(self, stats: messages.SplatStats) -> None:
        counts = self._counts
        counts.add("frames", of="incomplete" if self._lost else "finished")
        counts.add("packets", stats.packets)
        stages = ("planning", "merge", "splat", "waiting", "decoding")
        counts.add_all("frame_seconds", [(stage, getattr(stats, f"{stage}_seconds")) for stage in stages])
        counts.add_all("link_bytes", [("from map/shade servers", stats.bytes)])
        held_back = stats.held_back_seconds.items()
        counts.add_all("link_held_back_seconds", [(f"from map/shade server {n}", seconds) for n, seconds in held_back])
        counts.add_all("losses", [("map/shade server", 1.0) for _ in self._lost])

    def _tell_of_merge(self, assembly: FrameAssembly, reached: tuple[int, int], links: list[Connection]) -> None:
        """Have the workers leave out what is hidden, and come after."""
        self._reached_told = reached
        (begin, end), width = assembly.lines, assembly.plan.width
        tile_map = assembly.closed_tiles_of_lines
        seconds = max(NEWS_SECONDS, len(tile_map) * len(links) / NEWS_RATE)
        self._next_news = time.perf_counter() + seconds
        news = News(
            messages.MergeReached(frame=assembly.frame, sheet=reached[0], row=reached[1]),
            messages.TilesClosed(frame=assembly.frame, width=width, begin=begin, end=end),
            tile_map,
        )
        self._merge_news.post(news, links)

    def _stats(self, assembly: FrameAssembly) -> messages.SplatStats:
        links, frame = self._worker_links, assembly.frame
        frame_seconds = time.perf_counter() - self._frame_began
        return assembly.stats(
            links.received(frame),
            self._planning_seconds,
            frame_seconds,
            links.decoding_seconds(frame),
            links.held_back(),
        )

    # -- the client's requests, on the working thread

    @takes(messages.NameSession)
    def _name_session(self, request: messages.NameSession) -> None:
        name_session(request.session)

    @takes(messages.DescribeMachine)
    def _describe_machine(self, request: messages.DescribeMachine) -> None:
        described = messages.MachineDescribed(memory_bytes=available_memory(), threads=self._threads)
        self._outbox.post(described)

    @takes(messages.ReadClock)
    def _read_clock(self, request: messages.ReadClock) -> None:
        self._worker_links.trace()
        self._outbox.post_later(lambda: messages.ClockRead(clock()))

    @takes(messages.ReadTrace)
    def _read_trace(self, request: messages.ReadTrace) -> None:
        spans = self._spans
        self._outbox.post_later(lambda: spans.told(request.of_frame))  # the image that goes before is in it

    @takes(messages.MeasureLink)
    def _measure_link(self, request: messages.MeasureLink) -> None:
        self._client.send(messages.LinkMeasured(request.wanted), bytes(request.wanted))

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
            self._post_image(request)
        except Exception as error:
            self._outbox.post(refusal(self._answered(request), error))

    @takes(messages.ReadProgress)
    def _read_progress(self, request: messages.ReadProgress) -> None:
        if self._assembly is not None and self._assembly.frame == request.frame:
            self._outbox.post(messages.FrameProgress(request.frame, self._assembly.share_done))

    def _begin(self, request: messages.RenderFrame) -> None:
        log.info("frame %d has come", request.frame, extra={"event": "frame_begun", "frame": request.frame})
        self._frame_began = time.perf_counter()
        self._frame_came = min(self._newest_came, self._frame_began)
        self._spans = self._worker_links.spans(request.frame) if request.traced else UNTRACED
        self._worker_links.begin_frame()
        self._reached_told, self._lost = (0, 0), []
        self._drawing = False
        self._assembly = self._block = None
        assembly = FrameAssembly(self._owners, request.drawing.plan, request.frame, slabs_of(request))
        regions = regions_of(request.regions, self._client.id)
        block = self._outbox.images.target(assembly.published_bytes(regions))
        sources = sum(request.workers.values())
        assembly.begin(regions, sources, self._news, self._readable, block=block, traced=request.traced)
        self._assembly, self._block, self._request, self._drawing = assembly, block, request, True
        planned = time.perf_counter()
        self._planning_seconds = planned - self._frame_began
        self._spans.note("requests", "wait for its turn", self._frame_came, self._frame_began)
        self._spans.note("requests", "plan", self._frame_began, planned)
        with self._lock:  # what is held goes before all that comes
            instructions = self._merge.handle(FrameStarted(request.frame, request.workers, assembly.splat))
            refused = carried_out(instructions)
        self._worker_links.follow_merge()
        for refusal_of in refused:
            self._worker_links.cut_off(refusal_of)

    def _refuse_frame(self, request: messages.RenderFrame, error: Exception) -> None:
        self._abort(request.frame)  # its batches are on their way or here
        self._outbox.post(refusal(request, error))

    def _abort(self, frame: int) -> None:
        with self._lock:
            self._merge.handle(FrameDropped(frame))
        self._worker_links.follow_merge()
        if self._assembly is not None and self._assembly.frame <= frame:
            if self._drawing:
                self._counts.add("frames", of="given up")
                log.info("frame %d is given up", frame, extra={"event": "frame_given_up", "frame": frame})
            self._assembly.abort()
            self._drawing = False

    def _post_image(self, wanted: messages.ReadImage) -> None:
        assembly, request = self._assembly, self._request
        if assembly is None or request is None or assembly.frame != wanted.frame:
            return  # the client has gone on to another frame
        left, top, width, height = assembly.splat.rectangle
        complete = self._is_whole(assembly)
        step = assembly.plan.step
        image = messages.ImageRead(wanted.frame, step, complete, left, top, width, height, messages.RawPixels())
        pixels = self._block if complete and self._block is not None else self._shown(assembly, image.raw_bytes)
        answered, exact = self._answered(wanted), complete and request.exact
        self._outbox.post_image(image, pixels, exact, answered, self._spans)

    def _is_whole(self, assembly: FrameAssembly) -> bool:
        return not self._drawing and not self._lost and assembly.splat.complete

    def _answered(self, wanted: messages.ReadImage) -> messages.Message:
        """What an image answers: once it is finished the request of the frame, whether or not it was asked for."""
        finished = self._assembly is not None and self._is_whole(self._assembly)
        return self._request if finished and self._request is not None else wanted

    def _shown(self, assembly: FrameAssembly, nbytes: int) -> memoryview:
        """The image as it stands, in memory that the client sees if there is some."""
        target = self._outbox.images.target(nbytes)
        if target is None:
            return assembly.published()
        assembly.show(target)
        return target

    # -- what other threads bring

    def _receive_requests(self) -> None:
        try:
            while (received := self._client.receive()) is not None:
                if isinstance(received.message, messages.EndSession):
                    self._another = received.message.another
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
        self._worker_links.drop_uninvited()

    @takes(messages.ImagesTaken)
    def _images_taken(self, message: messages.ImagesTaken) -> None:
        self._outbox.images.taken(message)

    def _put(self, request: messages.Message) -> None:
        """Have the working thread answer it in its turn."""
        if isinstance(request, messages.RenderFrame):
            self._newest_came = clock()
        with self._lock:
            still_wanted = [waiting for waiting in self._requests if not superseded(waiting, request)]
            self._requests = deque([*still_wanted, request])
        self._news.ring()

    def _end(self, failure: VolsplatError | None = None) -> None:
        """The session is over; only the first cause counts."""
        with self._lock:
            if not self._over:
                self._over, self._failure = True, failure
                self._requests.append(None)
        self._news.ring()


OWNERS = (SplatServer, WorkerLinks)
HANDLERS = handlers(SplatServer)
check_handlers(taken_by(Role.SPLAT_SERVER), *OWNERS)
