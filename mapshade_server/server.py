"""The map/shade server's loop: takes the client's requests, holds sub-cubes, streams batches to the splat server.

One thread receives from the client and notes the newest frame and aborts at once; another works through the requests
in order. A frame is walked by threads of its own, which stop between two batches, so that an abort takes no longer than
a batch does; what is asked of the voxels that are held is answered meanwhile. What is asked of the file beside all
else, other threads read.
"""

import logging
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import replace

import msgspec

from volsplat.mapshade_server._kernels import Crew, NewestFrame, SignsOfLife
from volsplat.mapshade_server.answers.file_answers import FileAnswers, OfFiles
from volsplat.mapshade_server.answers.volume_answers import Answer
from volsplat.mapshade_server.answers.voxel_answers import OfVoxels, VoxelAnswers
from volsplat.mapshade_server.frames.frame_delivery import FrameDelivery
from volsplat.mapshade_server.frames.frame_tally import FrameTally
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.wanted_reader import GivenUp
from volsplat.mapshade_server.held_volume import NO_PAYLOAD, HeldVolume
from volsplat.mapshade_server.links.splat_links import SplatLinks
from volsplat.mapshade_server.readers.reading.data_root import DataRoot
from volsplat.mapshade_server.waiting_requests import WaitingRequests
from volsplat.program.counts import Counts
from volsplat.program.frame_spans import UNTRACED, FrameSpans, clock
from volsplat.program.log_lines import log_frame, name_session
from volsplat.program.machine_limits import available_memory
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.protocol.messages.refusals import refusal, why_unheard
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS, Heartbeat, patience_with_client
from volsplat.protocol.wire.tokens import Token

log = logging.getLogger(__name__)


class MapShadeServer:
    """One client's map/shade server. `run` returns when the client ends the session."""

    def __init__(
        self,
        client: Connection,
        token: Token,
        threads: int,
        held: HeldVolume | None = None,
        silence: float = SILENCE_SECONDS,
        data_root: DataRoot | None = None,
        encryption: Encryption = Encryption.BETWEEN_MACHINES,
        counts: Counts | None = None,
    ) -> None:
        """`threads` may walk. `held` may have what a client before had read. Volumes lie below `data_root`, if given.

        What is done is added to `counts`. Who says nothing for `silence` seconds is lost, the client later (see
        heartbeat).
        """
        self._client = client
        self._threads = threads
        self._data_root = data_root
        self._counts = counts or Counts()
        self._heartbeat = Heartbeat(silence, SignsOfLife)
        self._heartbeat.keep(client, patience_with_client(client, silence))
        self._requests = WaitingRequests()
        self._spans = UNTRACED  # of the newest frame
        self._frame_came = 0.0  # when that was received
        self._newest = NewestFrame()  # written by the receiving thread, read by the working one and the walkers
        self._over = False  # the client has ended the session …
        self._another = False  # … and begins another one at once
        self._failure: VolsplatError | None = None  # how the client was lost
        self._links = SplatLinks(token, lambda: self._ended, self._heartbeat, encryption, threads)
        self._crew = Crew()
        self._walking = ThreadPoolExecutor(1, "walk")
        self._reading_ahead = ThreadPoolExecutor(1, "read ahead")
        self._files = FileAnswers(data_root, lambda: self._heartbeat.at_work(client), self._give)
        self._newest_assignment = 0  # likewise
        self._held = held or HeldVolume()
        self._held.superseded = lambda assignment: self._newest_assignment > assignment

    def run(self) -> bool:
        """Serve until the client ends the session; returns whether it begins another one at once.

        Raises VolsplatError where the client is lost.
        """
        receiver = threading.Thread(target=self._receive, name="receive from client", daemon=True)
        receiver.start()
        try:
            while self._answer_next():
                pass
        except VolsplatError as error:
            self._failure = self._failure or error
        finally:
            self._client.close()
            self._links.close()
            self._heartbeat.close()
            receiver.join()
            self._walking.shutdown()
            self._files.end()
            self._held.give_up_reading()
            self._reading_ahead.shutdown()
        if self._failure is not None and not self._over:  # a client that ends need not wait for the last answer
            raise self._failure
        return self._another

    @property
    def _ended(self) -> bool:
        """The session is over, or the client lost."""
        return self._over or self._failure is not None

    def _receive(self) -> None:
        try:
            while self._receive_next():
                pass
        except Exception as error:  # whatever it is: nobody else hears the client
            self._failure = why_unheard(self._client, error)
            self._client.give_up(str(self._failure))
        self._newest.number = self._newest_assignment = sys.maxsize
        self._requests.end()
        # What is being sent is of no use any more, and a peer that does not read would hold it up for ever.
        self._client.close()
        self._links.interrupt()

    def _receive_next(self) -> bool:
        """Take what comes next. False at the end of the session; in between nothing here keeps a payload."""
        received = self._client.receive()
        if received is None:
            return False
        if received.message.ends:
            self._over = True
            self._another = isinstance(received.message, messages.EndSession) and received.message.another
            return False
        match received.message:
            case messages.RenderFrame(frame=frame):
                self._newest.number, self._frame_came = frame, clock()
            case messages.AbortFrame(frame=frame):
                self._newest.number = max(self._newest.number, frame + 1)
            case messages.OpenPackets(assignment=assignment):
                self._newest_assignment = assignment
            case messages.ConnectToSplatServers(routes=routes):
                self._links.interrupt_except(routes)  # who sends to one that is given up would send for ever
        self._requests.put(received)
        return True

    def _answer_next(self) -> bool:
        """Work through one request. False at the end of the session."""
        received = self._requests.get()
        if received is not None:
            self._answer(*received)
        return received is not None

    def _answer(self, request: messages.Message, payload: memoryview = NO_PAYLOAD) -> None:
        try:
            self._check_path(request)
            if isinstance(request, OfVoxels):
                self._answer_from_voxels(request)
            elif self._held.concerned(request):
                with self._heartbeat.at_work(self._client):
                    for answer in self._held.answers(request, payload):
                        self._give(answer)
            else:
                HANDLERS[type(request)].method(self, request)
        except Exception as error:  # whatever it is: the client must hear of it, and this server must go on
            self._client.send(msgspec.structs.replace(refusal(request, error), held=self._held.assignment))

    def _answer_from_voxels(self, request: OfVoxels) -> None:
        answers = VoxelAnswers(self._held.sub_cubes_asked(request))
        takes_long = isinstance(request, messages.SumDepths)  # the others are over before signs of life are left
        with self._heartbeat.at_work(self._client) if takes_long else nullcontext():
            self._give(answers.answer(request))

    def _check_path(self, request: messages.Message) -> None:
        """Raises BadInput for a volume that does not lie below the data root."""
        if isinstance(request, OfFiles):
            return  # looking at a path may take a slow disk long: its own thread does
        if self._data_root is not None and isinstance(path := getattr(request, "path", None), str):
            self._data_root.check(path)

    @takes(messages.NameSession)
    def _name_session(self, request: messages.NameSession) -> None:
        name_session(request.session)

    @takes(messages.DescribeMachine)
    def _describe_machine(self, request: messages.DescribeMachine) -> None:
        self._client.send(
            messages.MachineDescribed(memory_bytes=available_memory() + self._held.packed_bytes, threads=self._threads)
        )

    @takes(messages.MeasureLink)
    def _measure_link(self, request: messages.MeasureLink) -> None:
        self._client.send(messages.LinkMeasured(request.wanted), bytes(request.wanted))

    @takes(messages.ReadAhead)
    def _read_ahead(self, request: messages.ReadAhead) -> None:
        self._reading_ahead.submit(self._say_when_read, request, self._held.reading_ahead(request))

    def _say_when_read(self, request: messages.ReadAhead, read: Callable[[], None]) -> None:
        """Beside frames: in a thread of its own."""
        answer: messages.Message = messages.AheadRead(reading=request.reading)
        try:
            with ExitStack() as signs:
                with suppress(VolsplatError):  # the client is lost; who waits for what is read hears of it by that
                    signs.enter_context(self._heartbeat.at_work(self._client))
                read()
        except GivenUp:
            return
        except Exception as error:  # whatever it is: the client must hear of it
            answer = refusal(request, error)
        with suppress(VolsplatError):  # the client is lost, which others notice
            self._client.send(answer)

    @takes(messages.ReadVoxel)
    @takes(messages.ListFolder)
    def _look_at_files(self, request: OfFiles) -> None:
        self._files.ask(request)

    def _give(self, answer: Answer) -> None:
        self._client.send(answer.message, *answer.payload)

    # -- frames

    @takes(messages.ConnectToSplatServers)
    def _connect_to_splat_servers(self, request: messages.ConnectToSplatServers) -> None:
        self._links.connect(request.routes, self._client.id)
        self._client.send(messages.ConnectedToSplatServers(servers=list(self._links.of_servers)))

    @takes(messages.AbortFrame)
    def _abort_frame(self, request: messages.AbortFrame) -> None:
        # The frame's walk ended before this request's turn came.
        self._client.send(messages.FrameAborted(frame=request.frame))

    @takes(messages.RenderFrame)
    def _render_frame(self, request: messages.RenderFrame) -> None:
        sub_cubes = self._held.sub_cubes_asked(request)
        if not self._links.of_servers:
            raise BadInput(f"frame {request.frame} has nowhere to go: no splat server was named")
        came, started = self._frame_came, time.perf_counter()
        self._spans = spans = FrameSpans(request.frame, request.traced)
        log_frame(log, "frame_begun", request.frame, "has come")
        walkers = request.workers[self._client.id]
        with self._held.room_to_walk(request.drawing, sub_cubes):
            closed_tiles = self._links.begin_frame(request.frame, request.drawing.plan, walkers if request.paced else 0)
            walk = FrameWalk(sub_cubes, request.drawing, closed_tiles, request.regions, walkers)
            planned = time.perf_counter()
            delivery = FrameDelivery(request, self._client.id, walk, self._links.of_servers, self._newest, spans)
            tally = self._delivered(delivery)
        if self._newest.number <= request.frame:
            self._note_frame(spans, came, started, planned)
            stats = replace(tally, planning_seconds=planned - started).stats()
            took = f"{stats.packets} packets in {clock() - started:.3f} s"
            log_frame(log, "frame_mapped", request.frame, f"is mapped: {took}")
            self._count(stats, delivery.lost)
            self._client.send(messages.FrameMapped(frame=request.frame, stats=stats, lost=delivery.lost))
        else:
            log_frame(log, "frame_given_up", request.frame, "is given up")
            self._counts.add("frames", of="given up")

    def _count(self, stats: messages.MapShadeStats, lost: list[int]) -> None:
        counts, links = self._counts, [(f"to splat server {server}", link) for server, link in stats.links.items()]
        counts.add("frames", of="incomplete" if lost else "finished")
        counts.add("packets", stats.packets)
        counts.add("batches", stats.batches)
        stages = ("planning", "map_shade", "coding", "sending", "waiting")
        counts.add_all("frame_seconds", [(stage, getattr(stats, f"{stage}_seconds")) for stage in stages])
        counts.add_all("link_bytes", [(name, link.bytes) for name, link in links])
        counts.add_all("link_waiting_seconds", [(name, link.waiting_seconds) for name, link in links])
        counts.add_all("losses", [("splat server", 1.0) for _ in lost])

    @staticmethod
    def _note_frame(spans: FrameSpans, came: float, started: float, planned: float) -> None:
        """How a frame went that has ended now."""
        ended = clock()
        spans.note("requests", f"frame {spans.frame}", came, ended)
        spans.note("requests", "wait for its turn", came, started)
        spans.note("requests", "plan", started, planned)
        spans.note("requests", "walk and send", planned, ended)

    @takes(messages.ReadTrace)
    def _read_trace(self, request: messages.ReadTrace) -> None:
        self._client.send(self._spans.told(request.of_frame))

    @takes(messages.ReadClock)
    def _read_clock(self, request: messages.ReadClock) -> None:
        self._client.send(messages.ClockRead(clock()))

    def _delivered(self, delivery: FrameDelivery) -> FrameTally:
        """Have the walkers walk, and answer meanwhile what need not wait for the frame's end."""
        walking = self._walking.submit(delivery.run, self._crew, self._requests.wake)
        walking.add_done_callback(lambda _: self._requests.wake())
        try:
            while beside := self._requests.get_during(self._goes_beside, lambda: walking.done() or delivery.failed):
                self._answer(*beside)
            delivery.check()
            return walking.result()
        except Exception:
            delivery.end()  # they may be in sends that end when the client, which hears of it, aborts the frame
            raise

    def _goes_beside(self, request: messages.Message) -> bool:
        """Whether it can be answered from what is held now, or by other threads."""
        if isinstance(request, messages.ProbeVoxels | messages.ReadSlice | messages.CountPlane):
            return request.assignment == self._held.assignment
        return isinstance(request, OfFiles | messages.ReadAhead)


OWNERS = (MapShadeServer, HeldVolume, VoxelAnswers)
HANDLERS = handlers(MapShadeServer)

check_handlers(taken_by(Role.MAPSHADE_SERVER), *OWNERS)
