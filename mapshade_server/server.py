"""The map/shade server's loop: takes the client's requests, holds sub-cubes, streams batches to the splat server.

Two threads: one receives from the client and notes the newest frame and aborts at once; the other works through the
requests in order. A frame stops between two batches, so an abort takes no longer than a batch does; probes are
answered there as well.
"""

import sys
import threading
import time
from collections import deque

import msgspec

from volsplat.mapshade_server.data_link import DataLink
from volsplat.mapshade_server.frame_tally import FrameTally
from volsplat.mapshade_server.frame_walk import FrameWalk, ShadedBatch
from volsplat.mapshade_server.held_volume import NO_PAYLOAD, HeldVolume
from volsplat.mapshade_server.probe import front_most
from volsplat.mapshade_server.waiting_requests import WaitingRequests
from volsplat.program.available_memory import available_memory
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.protocol.messages.refusals import refusal, why_unheard
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.tokens import Token


class MapShadeServer:
    """One client's map/shade server. `run` returns when the client ends the session."""

    def __init__(self, client: Connection, token: Token, threads: int) -> None:
        """`threads` may walk."""
        self._client = client
        self._token = token
        self._threads = threads
        self._requests = WaitingRequests()
        self._probes: deque[messages.ProbeVoxels] = deque()  # among the requests, not answered yet
        self._newest_frame = 0  # written by the receiving thread, read by the working one
        self._over = False  # the client has ended the session
        self._failure: VolsplatError | None = None  # how the client was lost
        self._data_link: DataLink | None = None
        self._newest_assignment = 0  # likewise
        self._held = HeldVolume(lambda assignment: self._newest_assignment > assignment)

    def run(self) -> None:
        """Serve until the client ends the session. Raises VolsplatError where the client is lost."""
        receiver = threading.Thread(target=self._receive, name="receive from client", daemon=True)
        receiver.start()
        try:
            while self._answer_next():
                pass
        except VolsplatError as error:
            self._failure = self._failure or error
        finally:
            self._client.close()
            self._close_data_link()
            receiver.join()
        if self._failure is not None and not self._over:  # a client that ends need not wait for the last answer
            raise self._failure

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
        self._newest_frame = self._newest_assignment = sys.maxsize
        self._requests.end()
        # What is being sent is of no use any more, and a peer that does not read would hold it up for ever.
        self._client.close()
        link = self._data_link
        if link is not None:
            link.interrupt()

    def _receive_next(self) -> bool:
        """Take what comes next. False at the end of the session; in between nothing here keeps a payload."""
        received = self._client.receive()
        if received is None:
            return False
        if received.message.ends:
            self._over = True
            return False
        match received.message:
            case messages.RenderFrame(frame=frame):
                self._newest_frame = frame
            case messages.AbortFrame(frame=frame):
                self._newest_frame = max(self._newest_frame, frame + 1)
            case messages.OpenPackets(assignment=assignment):
                self._newest_assignment = assignment
            case messages.ProbeVoxels() as probe:
                self._probes.append(probe)
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
            if self._held.concerned(request):
                for answer in self._held.answers(request, payload):
                    self._client.send(answer.message, *answer.payload)
            else:
                HANDLERS[type(request)].method(self, request)
        except Exception as error:  # whatever it is: the client must hear of it, and this server must go on
            self._client.send(msgspec.structs.replace(refusal(request, error), held=self._held.assignment))

    @takes(messages.DescribeMachine)
    def _describe_machine(self, request: messages.DescribeMachine) -> None:
        self._client.send(messages.MachineDescribed(memory_bytes=available_memory(), threads=self._threads))

    # -- frames

    @takes(messages.ConnectToSplatServers)
    def _connect_to_splat_servers(self, request: messages.ConnectToSplatServers) -> None:
        if len(request.routes) != 1:
            raise BadInput(f"this version draws with one splat server, not {len(request.routes)}")
        route = request.routes[0]
        if self._data_link is None or self._data_link.closed or self._data_link.route != route:
            self._close_data_link()
            address, hello = Address(route.host, route.port), new_hello(Role.DATA_LINK, server=self._client.id)
            connection = connect(
                address,
                hello,
                self._token.bound_to(route.key),
                Role.SPLAT_SERVER,
                server=route.server,
                given_up=lambda: self._ended,
            )
            self._data_link = DataLink(route, connection)
        self._client.send(messages.ConnectedToSplatServers(servers=[route.server]))

    def _close_data_link(self) -> None:
        if self._data_link is not None:
            self._data_link.close()
        self._data_link = None

    @takes(messages.AbortFrame)
    def _abort_frame(self, request: messages.AbortFrame) -> None:
        # The frame's walk ended before this request's turn came.
        self._client.send(messages.FrameAborted(frame=request.frame))

    @takes(messages.RenderFrame)
    def _render_frame(self, request: messages.RenderFrame) -> None:
        self._held.check(request.assignment, f"frame {request.frame}")
        link = self._data_link
        if link is None:
            raise BadInput(f"frame {request.frame} has nowhere to go: no splat server was named")
        tally = FrameTally()
        started = time.perf_counter()
        plan = request.plan
        sub_cubes = self._held.sub_cubes_drawn(request.level, request.geometry, plan)
        tile_map = link.begin_frame(request.frame, plan.width, plan.height)
        walk = FrameWalk(sub_cubes, request.geometry, request.quantisation, request.shading, plan, tile_map)
        [walker] = walk.walkers
        tally.planning_seconds = time.perf_counter() - started
        while self._newest_frame <= request.frame:
            started = time.perf_counter()
            batch = walker.next_batch()
            tally.map_shade_seconds += time.perf_counter() - started
            if batch is None:
                self._client.send(messages.FrameMapped(frame=request.frame, stats=tally.stats(), lost=[]))
                return
            self._send_batch(link, request.frame, tally, batch)
            while self._probes and self._probes[0].assignment == self._held.assignment:
                self._answer(self._probes[0])

    @takes(messages.ProbeVoxels)
    def _probe_voxels(self, request: messages.ProbeVoxels) -> None:
        if not self._probes or self._probes[0] is not request:
            return  # it was answered between two batches
        self._probes.popleft()
        self._held.check(request.assignment, f"probe {request.probe}")
        sub_cubes = self._held.sub_cubes_drawn(request.level, request.geometry, request.line.plan)
        voxel = front_most(sub_cubes, request.geometry, request.quantisation, request.shading, request.line)
        self._client.send(messages.VoxelProbed(probe=request.probe, voxels=[voxel] if voxel else []))

    def _send_batch(self, link: DataLink, frame: int, tally: FrameTally, batch: ShadedBatch) -> None:
        message = messages.Batch(
            frame=frame,
            worker=self._client.id,
            walker=0,
            sequence=tally.batches,
            encoding=messages.RAW,
            parts=[messages.BatchPart(part.run_count, part.packet_count) for part in batch.parts],
            reached_sheet=batch.reached[0],
            reached_row=batch.reached[1],
            last=batch.last,
        )
        started, waited = time.perf_counter(), link.counters.seconds_in_send
        link.send(message, *(memory for part in batch.parts for memory in (part.runs, part.packets)))
        tally.sending_seconds += time.perf_counter() - started
        tally.waiting_seconds += link.counters.seconds_in_send - waited
        tally.count(batch)


OWNERS = (MapShadeServer, HeldVolume)
HANDLERS = handlers(MapShadeServer)

check_handlers(taken_by(Role.MAPSHADE_SERVER), *OWNERS)
