"""The splat server's loop over real sockets, with the test as its client and as its map/shade servers."""

import secrets
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from math import isclose
from random import Random

import msgspec
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from support.patience import PATIENCE, wait_until
from support.programs.little_memory import little_memory
from support.scenes.arbitrary import plain_scene
from support.scenes.owned import owners
from support.scenes.phantoms import QUANTISATION, shaded_scene, shells
from support.scenes.rendering import rendered
from support.scenes.shaded_packets import all_batches
from support.thoroughness import examples
from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.client.session.links.image_receiver import ImageReceiver
from volsplat.mapshade_server._kernels import Batch
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.batch_coder import QUICK, BatchCoder
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Image, Order, Scene, View
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.refusals import OUT_OF_MEMORY
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA, TILE_SIDE, tile_map_shape
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.levels import own_resolution
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import PeerLost, VolsplatError
from volsplat.protocol.text.want_of_threads import CURE, NO_THREAD
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import new_buffer
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token
from volsplat.splat_server import frame_assembly, worker_links
from volsplat.splat_server.frame_assembly import PIXELS_AT_ONCE, FrameAssembly, packets_at_once
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.outbox import Outbox
from volsplat.splat_server.server import SplatServer
from volsplat.splat_server.worker_links import WorkerLinks

SIZE = 24
VALUES = shells(SIZE)
GEOMETRY = Geometry(dims=(SIZE, SIZE, SIZE))
SCENE = shaded_scene(View(rotation=(0.2, 0.5, 0.1, 0.8), zoom=3.0), (96, 80))
WORKERS = (11, 12, 13)
KEYS = {worker: secrets.token_bytes(messages.WORKER_KEY_BYTES) for worker in WORKERS}


def request(frame: int, scene: Scene = SCENE, step: Step = Step.F) -> messages.RenderFrame:
    drawing = Drawing.planned(scene, step, GEOMETRY, QUANTISATION, own_resolution(GEOMETRY, step))
    regions = RegionShares().regions(drawing.plan, {1: 1})
    return messages.RenderFrame(frame, 1, drawing, dict.fromkeys(WORKERS, 1), regions, exact=True)


class Bench:
    """A splat server in a thread, and what a client and map/shade servers say to it."""

    def __init__(self) -> None:
        self._threads_before = set(threading.enumerate())  # some may be ending still
        token = new_token()
        self._clients = Listener(Role.CLIENT, token)
        invitations = Invitations(token)
        self._data = Listener(Role.SPLAT_SERVER, token, token_of=invitations.token_of)
        hello = new_hello(Role.SPLAT_SERVER, data_port=self._data.address.port)
        client = connect(self._clients.address, hello, token, Role.CLIENT)
        self._server = SplatServer(client, self._data, invitations, threads=2)
        self._token = token
        self.failure: VolsplatError | None = None  # of the server
        self._thread = threading.Thread(target=self._run, name="splat server under test", daemon=True)
        self._thread.start()
        control = self._clients.accept(PATIENCE)
        assert control is not None
        self.control: Connection = control
        self._images = ImageReceiver(control, new_buffer)
        control.send(messages.InviteWorkers(KEYS))
        self.links = {worker: self.linked(worker) for worker in WORKERS}
        self.picture = memoryview(b"")  # of the frame that was drawn last
        self.coder: BatchCoder | None = None  # of the batches that are sent

    def _run(self) -> None:
        try:
            self._server.run()
        except VolsplatError as error:
            self.failure = error

    def linked(self, worker: int) -> Connection:
        """A new data link of a worker."""
        hello = new_hello(Role.DATA_LINK, server=worker)
        return connect(self._data.address, hello, self._token.bound_to(KEYS[worker]), Role.SPLAT_SERVER, server=1)

    def link_anew(self, worker: int) -> None:
        """Once the server has noticed that the worker's link is lost, have it take another one."""
        for thread in self.link_threads(worker):
            thread.join(PATIENCE)
        self.links[worker] = self.linked(worker)
        while not self.link_threads(worker):
            assert not self.links[worker].closed

    def link_threads(self, worker: int) -> list[threading.Thread]:
        """The server's threads that receive from a worker."""
        name = f"receive from {Role.DATA_LINK} {worker} "
        mine = set(threading.enumerate()) - self._threads_before
        return [thread for thread in mine if thread.name.startswith(name)]

    @property
    def packets(self) -> int:
        """That are splatted of the newest frame."""
        frame = self._server._frame
        return frame.assembly.splat.packets if frame is not None else 0

    def fills_buffers(self, worker: int) -> None:
        """Wait until the server reads no more from a worker."""
        budgets = self._server._worker_links._budgets
        until = time.monotonic() + PATIENCE
        while worker not in budgets or budgets[worker].open:
            assert time.monotonic() < until

    def renders(self, frame: int, scene: Scene = SCENE, step: Step = Step.F) -> None:
        self.control.send(request(frame, scene, step))

    def sends(self, worker: int, frame: int, sequence: int, batch: Batch) -> None:
        coded = None if self.coder is None else self.coder.coded(parts_of(batch), QUICK)
        message = messages.Batch(
            frame,
            worker,
            0,
            sequence,
            0 if coded is None else len(coded),
            [messages.BatchPart(part.run_count, part.packet_count) for part in parts_of(batch)],
            batch.reached[0],
            batch.reached[1],
            batch.last,
        )
        raw = [memory for part in parts_of(batch) for memory in (part.runs, part.packets)]
        self.links[worker].send(message, *(raw if coded is None else [coded]))

    def sends_all(self, frame: int, of_workers: list[list[Batch]]) -> None:
        """What each worker has of a frame."""
        for worker, sent in zip(WORKERS, of_workers, strict=True):
            for sequence, batch in enumerate(sent):
                self.sends(worker, frame, sequence, batch)

    def draws(self, frame: int, of_workers: list[list[Batch]]) -> messages.FrameFinished:
        """A whole frame."""
        self.renders(frame)
        self.sends_all(frame, of_workers)
        finished = self.hears(messages.FrameFinished)[0]
        assert isinstance(finished, messages.FrameFinished)
        if finished.complete:
            image, self.picture = self.hears(messages.ImageRead)
            assert isinstance(image, messages.ImageRead) and image.complete and image.frame == frame
        return finished

    def hears(self, kind: type[messages.Message]) -> tuple[messages.Message, memoryview]:
        received = self.control.receive()
        assert received is not None and isinstance(received.message, kind), received
        message, payload = received
        if isinstance(message, messages.ImageRead):
            payload = self._images.pixels(message, payload)
        return message, payload

    def image(self, frame: int) -> bytes:
        self.control.send(messages.ReadImage(frame))
        return bytes(self.hears(messages.ImageRead)[1])

    def close(self) -> None:
        if not self.control.closed:
            self.control.send(messages.EndSession())
        self.ends()
        for link in self.links.values():
            link.close()
        self.control.close()
        self._clients.close()

    def ends(self) -> None:
        """Wait until the server has ended."""
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def batches(boxes: list[Box], scene: Scene = SCENE, step: Step = Step.F, max_packets: int = 500) -> list[list[Batch]]:
    """The batches of each box's own worker."""
    asked = request(1, scene, step)
    of_workers = []
    for box in boxes:
        sub_cube = SubCube.of_volume(GEOMETRY, VALUES, box)
        sub_cube.pack(QUANTISATION)
        walk = FrameWalk([sub_cube], asked.drawing, None, asked.regions)
        of_workers.append(all_batches(walk, max_packets))
    return of_workers


def slabs(axis: int, first: int, second: int) -> list[Box]:
    """Three boxes, cut across an axis."""
    boxes = []
    for low, high in ((0, first), (first, second), (second, SIZE)):
        corner = [[0, 0, 0], [SIZE, SIZE, SIZE]]
        corner[0][axis], corner[1][axis] = low, high
        boxes.append(Box((corner[0][0], corner[0][1], corner[0][2]), (corner[1][0], corner[1][1], corner[1][2])))
    return boxes


@settings(max_examples=examples(10))
@given(
    st.integers(0, 2),
    st.integers(1, 11),
    st.integers(12, 23),
    st.randoms(use_true_random=False),
    st.sampled_from(TRAVERSAL_ORDERS),
)
def test_the_image_is_the_same_for_any_arrival_order_over_sockets(
    axis: int, first: int, second: int, random: Random, order: Order
) -> None:
    scene = shaded_scene(SCENE.view, (96, 80), order)
    expected = rendered(VALUES, GEOMETRY, scene, Step.F)
    waiting = dict(zip(WORKERS, batches(slabs(axis, first, second), scene), strict=True))
    bench = Bench()
    begun = False
    sent = dict.fromkeys(WORKERS, 0)
    while not begun or any(sent[worker] < len(waiting[worker]) for worker in WORKERS):
        choices = [worker for worker in WORKERS if sent[worker] < len(waiting[worker])]
        if not begun and (not choices or random.random() < 0.2):
            bench.renders(1, scene)  # batches may be faster than the client's request
            begun = True
            continue
        worker = random.choice(choices)
        bench.sends(worker, 1, sent[worker], waiting[worker][sent[worker]])
        sent[worker] += 1
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and finished.complete
    image = torch.frombuffer(bytearray(bench.image(1)), dtype=torch.float32)
    bench.close()
    assert torch.equal(image, expected.flatten())


def test_nothing_of_a_frame_is_splatted_after_its_abort_is_acknowledged(bench: Bench) -> None:
    of_workers = batches(slabs(0, 8, 16))
    bench.renders(1)
    for worker, sent in zip(WORKERS, of_workers, strict=True):
        for sequence, batch in enumerate(sent[: len(sent) // 2]):
            bench.sends(worker, 1, sequence, batch)
    bench.control.send(messages.AbortFrame(1))
    bench.hears(messages.FrameAborted)
    at_acknowledgement = bench.image(1)
    for worker, sent in zip(WORKERS, of_workers, strict=True):
        for sequence, batch in enumerate(sent[len(sent) // 2 :], start=len(sent) // 2):
            bench.sends(worker, 1, sequence, batch)
    assert bench.image(1) == at_acknowledgement
    bench.renders(2)
    for worker, sent in zip(WORKERS, of_workers, strict=True):
        for sequence, batch in enumerate(sent):
            bench.sends(worker, 2, sequence, batch)
    bench.hears(messages.FrameFinished)
    image = torch.frombuffer(bytearray(bench.image(2)), dtype=torch.float32)
    assert torch.equal(image, rendered(VALUES, GEOMETRY, SCENE, Step.F).flatten())


def test_an_abort_ends_what_threads_are_still_splatting(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_assembly, "PIXELS_AT_ONCE", 1 << 28)  # so that a region takes long
    scene = shaded_scene(View(zoom=150.0), (2000, 2000), Order.BACK_TO_FRONT)
    bench.renders(1, scene)
    for worker, sent in zip(WORKERS, batches(slabs(0, 8, 16), scene), strict=True):
        for sequence, batch in enumerate(sent[:-1]):
            bench.sends(worker, 1, sequence, batch)
    while not bench.packets:
        assert bench.failure is None
    bench.control.send(messages.AbortFrame(1))
    bench.hears(messages.FrameAborted)
    packets = bench.packets
    assert bench.image(1) == bench.image(1) and bench.packets == packets


def test_a_front_server_need_not_wait_for_the_one_behind_it(bench: Bench) -> None:
    view = View(zoom=3.0)  # along k: sub-cubes cut across k lie one behind the other
    scene = shaded_scene(view, (96, 80))
    behind, between, front = batches(slabs(2, 8, 16), scene)
    bench.renders(1, scene)
    for worker, sent in ((WORKERS[2], front), (WORKERS[1], between), (WORKERS[0], behind)):
        for sequence, batch in enumerate(sent):
            bench.sends(worker, 1, sequence, batch)
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and finished.stats.held_back_seconds == {}


def test_beyond_the_budget_a_front_server_waits_and_the_report_shows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_links, "CONNECTION_BUDGET", 1000)
    scene = shaded_scene(View(zoom=3.0), (96, 80))
    behind, between, front = batches(slabs(2, 8, 16), scene, max_packets=50)
    bench = Bench()
    bench.renders(1, scene)

    def deliver(worker: int, sent: list[Batch]) -> None:
        for sequence, batch in enumerate(sent):
            bench.sends(worker, 1, sequence, batch)

    senders = [threading.Thread(target=deliver, args=pair) for pair in ((WORKERS[2], front), (WORKERS[1], between))]
    for sender in senders:
        sender.start()
    bench.fills_buffers(WORKERS[2])
    deliver(WORKERS[0], behind)
    for sender in senders:
        sender.join(PATIENCE)
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and finished.complete
    assert finished.stats.held_back_seconds.get(WORKERS[2], 0.0) > 0.0
    bench.close()


def test_who_waits_hears_how_far_a_frame_is(bench: Bench) -> None:
    def share() -> float:
        bench.control.send(messages.ReadProgress(1))
        said = bench.hears(messages.FrameProgress)[0]
        assert isinstance(said, messages.FrameProgress) and said.frame == 1
        return said.share

    def comes_to(passed: float) -> None:  # while no tile is closed
        wait_until(lambda: isclose(share(), passed), f"{passed} of it")

    bench.renders(1)
    sheets = request(1).drawing.plan.keys[0]
    for sequence, sheet in enumerate((0, sheets // 2, sheets - 1)):
        for worker in WORKERS:
            nothing = [messages.BatchPart(0, 0)]
            bench.links[worker].send(messages.Batch(1, worker, 0, sequence, 0, nothing, sheet, 0, False))
        comes_to(sheet / sheets)


def test_a_lost_worker_leaves_the_frame_incomplete_and_named(bench: Bench) -> None:
    of_workers = batches(slabs(1, 8, 16))
    bench.renders(1)
    for worker, sent in zip(WORKERS[:2], of_workers, strict=False):
        for sequence, batch in enumerate(sent):
            bench.sends(worker, 1, sequence, batch)
    bench.links[WORKERS[2]].close()
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished)
    assert not finished.complete and finished.lost == [WORKERS[2]]
    bench.control.send(messages.ReadImage(1))
    image = bench.hears(messages.ImageRead)[0]
    assert isinstance(image, messages.ImageRead) and not image.complete


def test_a_batch_that_breaks_the_rules_costs_its_sender_the_link_and_nobody_else(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    first, _, _ = batches(slabs(0, 8, 16))
    bench.renders(1)
    batch = next(batch for batch in first if parts_of(batch)[0].run_count > 1)
    [part] = parts_of(batch)
    hostile = bytearray(part.runs)
    hostile[:12] = b"\xff" * 12  # a sheet, row and sample far beyond the volume
    message = messages.Batch(
        1,
        WORKERS[0],
        0,
        0,
        0,
        [messages.BatchPart(part.run_count, part.packet_count)],
        *batch.reached,
        False,
    )
    bench.links[WORKERS[0]].send(message, hostile, part.packets)
    with pytest.raises(VolsplatError):
        bench.links[WORKERS[0]].receive()
    assert len([record for record in caplog.records if record.levelname == "WARNING"]) == 1
    bench.control.send(messages.AbortFrame(1))
    bench.hears(messages.FrameAborted)


def test_a_link_that_takes_the_place_of_another_is_no_loss(bench: Bench) -> None:
    of_workers = batches(slabs(0, 8, 16))
    assert bench.draws(1, of_workers).complete
    worker = WORKERS[1]
    [old_thread] = bench.link_threads(worker)
    old, bench.links[worker] = bench.links[worker], bench.linked(worker)
    assert bench.draws(2, of_workers).complete
    old.close()
    old_thread.join(PATIENCE)
    assert bench.draws(3, of_workers).complete
    bench.links[worker].close()
    bench.renders(4)
    for other in (WORKERS[0], WORKERS[2]):
        for sequence, batch in enumerate(of_workers[WORKERS.index(other)]):
            bench.sends(other, 4, sequence, batch)
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and finished.lost == [worker]
    bench.link_anew(worker)
    assert bench.draws(5, of_workers).complete


@pytest.mark.parametrize("skipped", [0, 2], ids=["repeated", "missing"])
def test_a_batch_that_is_missing_or_repeated_ends_its_link(
    bench: Bench, skipped: int, caplog: pytest.LogCaptureFixture
) -> None:
    first, second, third = batches(slabs(0, 8, 16), max_packets=50)
    bench.renders(1)
    bench.sends(WORKERS[0], 1, 0, first[0])
    bench.sends(WORKERS[0], 1, skipped, first[skipped])
    with pytest.raises(VolsplatError):
        bench.links[WORKERS[0]].receive()
    assert f"link 11 on this machine broke the protocol: Batch.sequence is {skipped}, but 1 is due" in caplog.text
    for worker, sent in ((WORKERS[1], second), (WORKERS[2], third)):
        for sequence, batch in enumerate(sent):
            bench.sends(worker, 1, sequence, batch)
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and finished.lost == [WORKERS[0]]


def test_a_batch_of_an_older_frame_behind_one_of_a_newer_ends_its_link(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    first = batches(slabs(0, 8, 16))[0]
    bench.renders(2)
    bench.sends(WORKERS[0], 2, 0, first[0])
    bench.sends(WORKERS[0], 1, 0, first[0])
    with pytest.raises(VolsplatError):
        bench.links[WORKERS[0]].receive()
    assert "broke the protocol: a batch of frame 1 came after one of frame 2" in caplog.text


def test_a_frame_that_cannot_be_drawn_is_refused_and_the_next_one_drawn(bench: Bench) -> None:
    of_workers = batches(slabs(0, 8, 16))
    assert bench.draws(1, of_workers).complete
    for worker, sent in zip(WORKERS, of_workers, strict=True):
        bench.sends(worker, 2, 0, sent[0])
    asked = request(2)
    plan = asked.drawing.plan
    huge = msgspec.structs.replace(plan.footprint, half_width=1e5, half_height=1e5)  # type: ignore[type-var]
    drawing = msgspec.structs.replace(asked.drawing, plan=msgspec.structs.replace(plan, footprint=huge))
    bench.control.send(msgspec.structs.replace(asked, drawing=drawing))
    refused = bench.hears(messages.Refused)[0]
    assert isinstance(refused, messages.Refused)
    assert (refused.request, refused.frame) == ("RenderFrame", 2) and "lower the zoom" in refused.cause
    assert bench.draws(3, of_workers).complete


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to the limit")
def test_an_image_beyond_the_memory_is_refused_with_the_cure(bench: Bench) -> None:
    of_workers = batches(slabs(0, 8, 16))
    with little_memory(1 << 30):
        bench.renders(1, msgspec.structs.replace(SCENE, image=Image(width=16384, height=16384)))
        refused = bench.hears(messages.Refused)[0]
    assert refused == messages.Refused("RenderFrame", OUT_OF_MEMORY, frame=1, assignment=1)
    assert bench.draws(2, of_workers).complete


@pytest.mark.parametrize("by_memory", [True, False])
def test_an_image_that_cannot_be_handed_out_is_refused_and_the_next_one_drawn(
    by_memory: bool, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where there is no memory to code it in. The client asked for the frame alone."""
    of_workers, images = batches(slabs(0, 8, 16)), bench._server._outbox.images

    def no_memory(*_: object) -> float:
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(images, "send", no_memory)
        if not by_memory:
            patched.setattr(images, "shares", lambda pixels: False)
        bench.renders(1)
        bench.sends_all(1, of_workers)
        bench.hears(messages.FrameFinished)
        assert bench.hears(messages.Refused)[0] == messages.Refused("RenderFrame", OUT_OF_MEMORY, frame=1, assignment=1)
    assert bench.draws(2, of_workers).complete


def test_a_server_that_can_say_nothing_more_to_the_client_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(*_: object) -> None:
        raise MemoryError

    bench = Bench()
    monkeypatch.setattr(bench._server._client, "send_at_once", lambda message: False)
    monkeypatch.setattr(bench._server._client, "send", no_room)
    bench.control.send(messages.AbortFrame(1))
    bench.ends()
    assert str(bench.failure).startswith("the memory does not suffice for what is sent to ")
    bench.control.close()
    bench.close()


def test_a_worker_that_is_not_heard_any_more_is_lost(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever ends the thread that receives from it: the frame must not wait for ever."""

    def fault(*_: object) -> None:
        raise RuntimeError("an internal error")

    monkeypatch.setattr(bench._server._worker_links, "_push", fault)
    bench.renders(1)
    bench.sends(WORKERS[0], 1, 0, batches(slabs(0, 8, 16))[0][0])
    for worker in WORKERS[1:]:
        bench.links[worker].close()
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and set(finished.lost) == set(WORKERS)


def test_a_lost_client_ends_the_server_and_its_links(bench: Bench) -> None:
    bench.renders(1)
    bench.control.close()
    bench.ends()
    assert isinstance(bench.failure, PeerLost)
    with pytest.raises(PeerLost):
        bench.links[WORKERS[0]].receive()


def test_a_link_that_is_taken_up_as_the_server_ends_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    ending, take_up, close = threading.Event(), WorkerLinks._take_up, WorkerLinks.close

    def late(data_links: WorkerLinks, link: Connection) -> None:
        ending.wait(PATIENCE)
        take_up(data_links, link)

    def closed(data_links: WorkerLinks) -> None:
        ending.set()
        close(data_links)

    monkeypatch.setattr(WorkerLinks, "_take_up", late)
    monkeypatch.setattr(WorkerLinks, "close", closed)
    bench = Bench()
    bench.control.close()
    bench.ends()
    for link in bench.links.values():
        with pytest.raises(PeerLost):
            link.receive()
    bench.close()


def test_a_server_waits_for_the_threads_of_its_links(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that was in a kernel when the interpreter ends would abort the process."""
    ended, lose = threading.Event(), WorkerLinks._lose

    def late(data_links: WorkerLinks, link: Connection) -> None:
        ended.wait(0.5)
        lose(data_links, link)

    monkeypatch.setattr(WorkerLinks, "_lose", late)
    bench = Bench()
    bench.control.close()
    bench.ends()
    assert not any(map(bench.link_threads, WORKERS))
    ended.set()
    bench.close()


def test_an_image_that_nobody_reads_holds_up_nothing_but_the_messages_behind_it(bench: Bench) -> None:
    token, events = new_token(), list[str]()
    sent, failed = threading.Event(), threading.Event()

    def fail(error: VolsplatError) -> None:
        events.append(str(error))
        failed.set()

    with Listener(Role.CLIENT, token) as clients:
        client = connect(clients.address, new_hello(Role.SPLAT_SERVER, data_port=1), token, Role.CLIENT)
        control = clients.accept(PATIENCE)
        assert control is not None
        outbox = Outbox(client, image_sent=sent.set, failed=fail)
        aborts = [messages.AbortFrame(frame) for frame in range(2, 30)]
        for request in (messages.ReadImage(1), *aborts):
            control.send(request)
            client.receive()
        pixels = bytes(2048 * 2048 * 16)  # far more than sockets buffer
        read = messages.ImageRead(1, Step.F, True, 0, 0, 2048, 2048, messages.RawPixels())
        outbox.post_image(read, memoryview(pixels), exact=True, request=messages.ReadImage(1))
        outbox.post(messages.FrameAborted(2))
        assert outbox.holds_image and not sent.is_set()
        image, abort = control.receive(), control.receive()
        assert image is not None and len(image.payload) == len(pixels)
        assert abort is not None and abort.message == messages.FrameAborted(2)
        assert sent.wait(PATIENCE) and not outbox.holds_image
        control.close()
        for abort_of in aborts[1:]:
            outbox.post(messages.FrameAborted(abort_of.frame))
        failed.wait(PATIENCE)
        assert "is gone" in events[0]
        client.close()
        outbox.close()


def test_of_images_that_wait_for_one_that_nobody_reads_only_those_of_the_newest_frame_are_kept(bench: Bench) -> None:
    server, frames = bench._server, range(1, 101)
    server._outbox.holds_image = True  # as until it is read
    for frame in frames:
        for _ in range(2):
            bench.control.send(messages.ReadImage(frame))
    newest = messages.ReadImage(frames[-1])
    wait_until(lambda: list(server._images_wanted) == [newest, newest], "are these alone left")


def test_images_asked_for_at_once_are_each_answered(bench: Bench) -> None:
    assert bench.draws(1, batches(slabs(0, 8, 16))).complete
    for _ in range(5):
        bench.control.send(messages.ReadImage(1))
    images = {bytes(bench.hears(messages.ImageRead)[1]) for _ in range(5)}
    assert images == {bytes(bench.picture)}


@settings(max_examples=examples(40))
@given(st.floats(0.3, 200), st.sampled_from(PAPER_STEPS), st.tuples(*[st.floats(-1, 1)] * 3))
@example(104.0, Step.C, (0.5, 0.5, 1.0))  # the sheet axis adds the most to what a cell reaches
def test_a_packet_reaches_no_more_pixels_than_a_turn_of_the_splatter_counts(
    zoom: float, step: Step, turn: tuple[float, float, float]
) -> None:
    view = View(rotation=(*turn, 1.0), zoom=zoom)
    scene = shaded_scene(view, (200, 160))
    geometry = Geometry(dims=(1, 1, 1))
    values = torch.full((1, 1, 1), 200.0, dtype=torch.float64)
    touched = int((rendered(values, geometry, scene, step)[..., 3] > 0).sum())
    with owners() as made:
        counted = FrameAssembly(made, plan_frame(scene, geometry, step), 1).pixels_per_packet
    assert touched <= counted <= 64 * (touched + 200 + 160)
    assert packets_at_once(counted) * counted <= max(PIXELS_AT_ONCE, counted)


def test_unfinished_workers_hear_which_tiles_are_closed_and_these_are_frozen(bench: Bench) -> None:
    """An opaque cube in three slabs, one behind the other: the nearest hides the others."""
    width, height = 96, 80
    scene = plain_scene(view=View(zoom=4.0), size=(width, height), order=Order.FRONT_TO_BACK)
    of_workers = batches(slabs(2, 8, 16), scene, max_packets=200)
    bench.renders(1, scene)
    *rest, last = [
        (worker, sequence, batch)
        for worker, sent in zip(WORKERS, of_workers, strict=True)
        for sequence, batch in enumerate(sent)
    ]
    for worker, sequence, batch in rest:
        bench.sends(worker, 1, sequence, batch)
    closed = torch.zeros(height // TILE_SIDE, width // TILE_SIDE, dtype=torch.bool)
    reached = (0, 0)
    while not closed.any():
        received = bench.links[last[0]].receive()
        assert received is not None
        if isinstance(received.message, messages.MergeReached):
            assert reached < (reached := (received.message.sheet, received.message.row))
            continue
        assert received.message == messages.TilesClosed(1, width, 0, height)
        tiles = received.payload.cast("Q", tile_map_shape(width, height))
        closed = torch.tensor(
            [[bool(tiles[r, 0] >> c & 1) for c in range(closed.shape[1])] for r in range(len(closed))]
        )
    bench.sends(last[0], 1, *last[1:])
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and finished.stats.hidden_packets > 0
    pixels = bytearray(bench.hears(messages.ImageRead)[1])
    alpha = torch.frombuffer(pixels, dtype=torch.float32).reshape(height, width, 4)[..., 3]
    in_tiles = alpha.unfold(0, TILE_SIDE, TILE_SIDE).unfold(1, TILE_SIDE, TILE_SIDE)
    assert float(in_tiles[closed].min()) >= FROZEN_ALPHA


def test_a_server_that_cannot_hear_the_client_any_more_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_thread(_: object) -> None:
        raise RuntimeError("can't start new thread")

    bench = Bench()
    monkeypatch.setattr(bench._server._invitations, "replace", no_thread)
    bench.control.send(messages.InviteWorkers(KEYS))
    bench.ends()
    assert str(bench.failure) == "the client is not heard any more: RuntimeError: can't start new thread"
    bench.control.close()
    bench.close()


@pytest.fixture
def first_links_find_no_thread(monkeypatch: pytest.MonkeyPatch) -> Callable[[], AbstractContextManager[None]]:
    """Meanwhile a thread cannot be had for links of the first worker."""
    start = threading.Thread.start

    def starts(self: threading.Thread) -> None:
        if self.name.startswith(f"receive from {Role.DATA_LINK} {WORKERS[0]} "):
            raise RuntimeError(NO_THREAD)
        start(self)

    @contextmanager
    def meanwhile() -> Iterator[None]:
        with monkeypatch.context() as patch:
            patch.setattr(threading.Thread, "start", starts)
            yield

    return meanwhile


def test_a_link_for_which_there_is_no_thread_is_dropped_and_the_next_one_taken(
    bench: Bench, first_links_find_no_thread: Callable[[], AbstractContextManager[None]]
) -> None:
    with first_links_find_no_thread(), bench.linked(WORKERS[0]) as link, pytest.raises(PeerLost):
        link.receive()
    bench.links[WORKERS[0]].close()  # it was replaced
    bench.link_anew(WORKERS[0])
    assert bench.draws(1, batches(slabs(0, 8, 16))).complete


def test_a_frame_whose_worker_finds_no_thread_is_refused_with_the_cause(
    bench: Bench, first_links_find_no_thread: Callable[[], AbstractContextManager[None]]
) -> None:
    bench.renders(1)
    bench.control.send(messages.ReadProgress(frame=1))
    bench.hears(messages.FrameProgress)  # it has begun
    with first_links_find_no_thread(), bench.linked(WORKERS[0]) as link, pytest.raises(PeerLost):
        link.receive()
    assert bench.hears(messages.Refused)[0] == messages.Refused("RenderFrame", CURE, frame=1, assignment=1)
    bench.links[WORKERS[0]].close()
    bench.link_anew(WORKERS[0])
    assert bench.draws(2, batches(slabs(0, 8, 16))).complete


def test_coded_batches_give_the_same_picture(bench: Bench) -> None:
    of_workers = batches(slabs(0, 8, 16))
    assert bench.draws(1, of_workers).stats.decoding_seconds == 0.0
    picture = bytes(bench.picture)
    bench.coder = BatchCoder(plan_frame(SCENE, GEOMETRY, Step.F))
    stats = bench.draws(2, of_workers).stats
    assert bytes(bench.picture) == picture
    assert stats.decoding_seconds > 0.0
    assert stats.bytes < 24 * stats.packets


def test_a_code_that_is_none_loses_its_worker_alone(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    bench.renders(1)
    part = messages.BatchPart(1, 2)
    bench.links[WORKERS[0]].send(messages.Batch(1, WORKERS[0], 0, 0, 9, [part], 0, 0, False), bytes(9))
    for worker, sent in list(zip(WORKERS, batches(slabs(0, 8, 16)), strict=True))[1:]:
        for sequence, batch in enumerate(sent):
            bench.sends(worker, 1, sequence, batch)
    finished = bench.hears(messages.FrameFinished)[0]
    assert isinstance(finished, messages.FrameFinished) and finished.lost == [WORKERS[0]]
    assert "broke the protocol: frame 1: its code cannot be decompressed" in caplog.text
