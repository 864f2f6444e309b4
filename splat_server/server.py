"""The splat server's loop: has what map/shade servers send splatted, and hands out the image at any time.

One thread answers the client. The regions' owners, threads of the kernels, merge and splat meanwhile (see
frame_assembly); others receive from the client, send to it (see outbox), and receive from the map/shade servers (see
worker_links).
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from volsplat.program.counts import Counts
from volsplat.program.frame_spans import UNTRACED, FrameSpans, clock
from volsplat.program.log_lines import log_frame, name_session
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
from volsplat.splat_server.merge_news import MergeNews, News
from volsplat.splat_server.outbox import Outbox
from volsplat.splat_server.slabs import slabs_of
from volsplat.splat_server.worker_links import WorkerLinks

NEWS_SECONDS = 0.002  # between two news of the merge, and more if maps of closed tiles are large
NEWS_RATE = 100e6  # bytes a second, over all links
LOOK_SECONDS = 1.0  # between two looks at the frame, if nothing is told


log = logging.getLogger(__name__)


@dataclass
class _Frame:
    """As the working thread knows it; moments are those of its spans' clock."""

    request: messages.RenderFrame
    assembly: FrameAssembly
    block: memoryview | None  # that the client sees, and the image is published in
    spans: FrameSpans
    came: float
    began: float
    planned: float
    drawing: bool = True  # it is not finished
    lost: Sequence[int] = ()  # workers that its finished image lacks
    reached_told: tuple[int, int] = (0, 0)  # sheet and row, when the workers last heard of the merge

    @property
    def number(self) -> int:
        return self.request.frame

    @property
    def is_whole(self) -> bool:
        return not self.drawing and not self.lost and self.assembly.splat.complete


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
        self._lock = threading.Lock()  # guards what follows
        self._requests: deque[messages.Message | None] = deque()  # None: the session is over
        self._over = False
        self._another = False  # the client ended the session, and begins another one at once
        self._failure: VolsplatError | None = None  # why the session is over, unless the client ended it
        # Touched by the working thread alone.
        self._images_wanted: deque[messages.ReadImage] = deque()  # asked for while another was being sent
        self._frame: _Frame | None = None  # the newest, unless it was refused
        self._newest_came = 0.0  # when the newest request of a frame did; the receiving thread's
        self._next_news = 0.0

        self._heartbeat = Heartbeat(silence)
        self._heartbeat.keep(client, patience_with_client(client, silence))
        self._worker_links = WorkerLinks(data_links, invitations, self._news, self._heartbeat)
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
        except VolsplatError as error:
            self._end(error)
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
        frame = self._frame
        self._worker_links.look_at_channels()
        if frame is None or not frame.drawing:
            return LOOK_SECONDS
        try:
            self._worker_links.check_served()
            complete = frame.assembly.splat.complete
        except Exception as error:
            self._refuse_frame(frame.request, error)
            return LOOK_SECONDS
        if complete:
            self._finish(frame)
            return 0.0
        if not frame.assembly.plan.hides:
            return LOOK_SECONDS
        if (early := self._next_news - time.perf_counter()) > 0:
            return early
        if not (links := self._worker_links.to_tell_of_merge()):
            return LOOK_SECONDS
        if (reached := frame.assembly.splat.reached()) != frame.reached_told:
            frame.reached_told = reached
            self._tell_of_merge(frame.assembly, reached, links)
        return LOOK_SECONDS

    def _finish(self, frame: _Frame) -> None:
        frame.drawing = False
        frame.assembly.note_owners(frame.spans, frame.began)
        self._worker_links.note_taken(frame.number)
        frame.spans.note("requests", f"frame {frame.number}", frame.came, clock())
        links = self._worker_links
        frame.lost = links.lost
        stats = frame.assembly.stats(
            links.received(frame.number),
            frame.planned - frame.began,
            time.perf_counter() - frame.began,
            links.decoding_seconds(frame.number),
            links.held_back(),
        )
        took = f"{stats.packets} packets in {stats.frame_seconds:.3f} s"
        log_frame(log, "frame_finished", frame.number, f"is finished: {took}")
        self._count(stats, frame.lost)
        lost = list(frame.lost)
        self._outbox.post(messages.FrameFinished(frame=frame.number, complete=not lost, lost=lost, stats=stats))
        if not lost:
            # Whoever asked for it as it stood gets it finished.
            self._images_wanted = deque([messages.ReadImage(frame=frame.number)])

    def _count(self, stats: messages.SplatStats, lost: Sequence[int]) -> None:
        counts = self._counts
        counts.add("frames", of="incomplete" if lost else "finished")
        counts.add("packets", stats.packets)
        stages = ("planning", "merge", "splat", "waiting", "decoding")
        counts.add_all("frame_seconds", [(stage, getattr(stats, f"{stage}_seconds")) for stage in stages])
        counts.add_all("link_bytes", [("from map/shade servers", stats.bytes)])
        held_back = stats.held_back_seconds.items()
        counts.add_all("link_held_back_seconds", [(f"from map/shade server {n}", seconds) for n, seconds in held_back])
        counts.add_all("losses", [("map/shade server", 1.0) for _ in lost])

    def _tell_of_merge(self, assembly: FrameAssembly, reached: tuple[int, int], links: list[Connection]) -> None:
        """Have the workers leave out what is hidden, and come after."""
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
        spans = UNTRACED if self._frame is None else self._frame.spans
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
        if (frame := self._frame) is not None and frame.number == request.frame:
            self._outbox.post(messages.FrameProgress(request.frame, frame.assembly.share_done))

    def _begin(self, request: messages.RenderFrame) -> None:
        log_frame(log, "frame_begun", request.frame, "has come")
        began = time.perf_counter()
        came = min(self._newest_came, began)
        spans = self._worker_links.spans(request.frame) if request.traced else UNTRACED
        self._worker_links.forget_waits()
        self._frame = None
        assembly = FrameAssembly(self._owners, request.drawing.plan, request.frame, slabs_of(request))
        regions = regions_of(request.regions, self._client.id)
        block = self._outbox.images.target(assembly.published_bytes(regions))
        sources = sum(request.workers.values())
        assembly.begin(regions, sources, self._news, self._worker_links.readable, block=block, traced=request.traced)
        planned = time.perf_counter()
        self._frame = _Frame(request, assembly, block, spans, came, began, planned)
        spans.note("requests", "wait for its turn", came, began)
        spans.note("requests", "plan", began, planned)
        self._worker_links.start_frame(request.frame, request.workers, assembly.splat)

    def _refuse_frame(self, request: messages.RenderFrame, error: Exception) -> None:
        self._abort(request.frame)  # its batches are on their way or here
        self._outbox.post(refusal(request, error))

    def _abort(self, number: int) -> None:
        self._worker_links.drop_frame(number)
        frame = self._frame
        if frame is not None and frame.number <= number:
            if frame.drawing:
                self._counts.add("frames", of="given up")
                log_frame(log, "frame_given_up", number, "is given up")
            frame.assembly.abort()
            frame.drawing = False

    def _post_image(self, wanted: messages.ReadImage) -> None:
        frame = self._frame
        if frame is None or frame.number != wanted.frame:
            return  # the client has gone on to another frame
        left, top, width, height = frame.assembly.splat.rectangle
        complete, step = frame.is_whole, frame.assembly.plan.step
        image = messages.ImageRead(wanted.frame, step, complete, left, top, width, height, messages.RawPixels())
        published = frame.block if complete else None
        pixels = self._shown(frame.assembly, image.raw_bytes) if published is None else published
        exact = complete and frame.request.exact
        self._outbox.post_image(image, pixels, exact, self._answered(wanted), frame.spans)

    def _answered(self, wanted: messages.ReadImage) -> messages.Message:
        """What an image answers: once it is finished the request of the frame, whether or not it was asked for."""
        frame = self._frame
        return frame.request if frame is not None and frame.is_whole else wanted

    def _shown(self, assembly: FrameAssembly, nbytes: int) -> memoryview:
        """The image as it stands, in memory that the client sees if there is some."""
        target = self._outbox.images.target(nbytes)
        if target is None:
            return assembly.published()
        assembly.splat.show(target)
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
        if failure is not None:
            self._client.give_up(str(failure))  # so that who follows SIGTERM knows of it, whatever the others are at
        self._news.ring()


OWNERS = (SplatServer, WorkerLinks)
HANDLERS = handlers(SplatServer)
check_handlers(taken_by(Role.SPLAT_SERVER), *OWNERS)
