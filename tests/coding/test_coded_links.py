"""Coded batches on real links: over a slow one the same bytes come as fewer, within a machine nothing is coded."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
import torch

from support.patience import PATIENCE
from support.scenes.arbitrary import plain_scene
from support.scenes.coded_batches import raw_bytes
from support.scenes.shaded_packets import all_batches
from support.scenes.shadings import WINDOW
from volsplat.bench.slow_link import slow_link
from volsplat.mapshade_server._kernels import Batch
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.batch_coder import CLOSE, QUICK
from volsplat.mapshade_server.links.data_link import DataLink, Sent
from volsplat.mapshade_server.links.link_coding import BYTES_WITHOUT_WAIT, RAW, CodingChoice
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.closed_tiles import new_tile_map
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token
from volsplat.splat_server.batch_decoder import decoded

GEOMETRY = Geometry((48, 48, 48))
PLAIN = Quantisation(window=WINDOW, strength_scale=50.0)
SLOW = 300e6  # bits a second
FRAMES = 24


@contextmanager
def linked(bits_per_second: float) -> Iterator[tuple[DataLink, Connection]]:
    """A data link, at its other end a connection, through a slow network."""
    token = new_token()
    with ExitStack() as stack:
        listener = Listener(Role.SPLAT_SERVER, token)
        stack.callback(listener.close)
        port = stack.enter_context(slow_link(listener.address.port, bits_per_second=bits_per_second, round_trip=0.001))
        route = messages.Route(1, listener.address.host, port, bytes(32))
        hello = new_hello(Role.DATA_LINK, server=3)
        address = Address(route.host, route.port)
        link = DataLink(route, connect(address, hello, token, Role.SPLAT_SERVER, server=1))
        stack.callback(link.close)
        there = listener.accept(PATIENCE)
        assert there is not None
        yield link, stack.enter_context(there)


def frame_of(batches: list[Batch], link: DataLink, frame: int, plan: FramePlan, costs: list[Sent]) -> None:
    link.begin_frame(frame, plan, new_tile_map(plan.width, plan.height), paced_walkers=0)
    for sequence, batch in enumerate(batches):
        parts = [messages.BatchPart(part.run_count, part.packet_count) for part in parts_of(batch)]
        message = messages.Batch(frame, 3, 0, sequence, 0, parts, *batch.reached, batch.last)
        costs.append(link.send(message, parts_of(batch)))


@pytest.mark.parametrize("step", [Step.F, Step.G])
def test_over_a_slow_link_batches_come_coded_and_have_the_same_bytes(step: Step) -> None:
    batches, costs, coded = sent_over(SLOW, step)
    assert coded
    saved = FRAMES * sum(len(raw_bytes(parts_of(batch))) for batch in batches) - sum(cost.nbytes for cost in costs)
    assert saved > 0
    assert sum(cost.coding_seconds for cost in costs) > 0.0


def sent_over(bits_per_second: float, step: Step = Step.F) -> tuple[list[Batch], list[Sent], int]:
    """Frames sent and compared; the batches of one, what each cost, and how many came coded."""
    scene = plain_scene(opacity=0.5, view=View(rotation=(0.1, 0.2, 0.0, 1.0), zoom=4.0), size=(256, 256))
    plan = plan_frame(scene, GEOMETRY, step)
    sub_cube = SubCube.of_volume(GEOMETRY, torch.rand(GEOMETRY.dims, generator=torch.Generator().manual_seed(1)))
    sub_cube.pack(PLAIN)
    batches = all_batches(FrameWalk([sub_cube], Drawing.of(scene, plan, GEOMETRY, PLAIN)), 16384)
    costs: list[Sent] = []
    came = 0
    with linked(bits_per_second) as (link, there):

        def send() -> None:
            for frame in range(1, FRAMES + 1):
                frame_of(batches, link, frame, plan, costs)

        sending = threading.Thread(target=send)
        sending.start()
        for batch in batches * FRAMES:
            received = there.receive()
            assert received is not None and isinstance(received.message, messages.Batch)
            message, payload = received.message, bytes(received.payload)
            if message.coded_bytes:
                came += 1
                room = bytearray(message.raw_bytes)
                decoded(memoryview(payload), message.parts, memoryview(room))
                payload = bytes(room)
            assert payload == raw_bytes(parts_of(batch))
        sending.join(PATIENCE)
        assert not sending.is_alive()
    return batches, costs, came


RAW_BYTES = 1 << 20


def told(choice: CodingChoice, rate: float, batches: int, at: float = 0.0) -> float:
    """Batches over a link that carries so many bytes a second, each sent as is chosen; when the last one had gone."""
    ratios = {RAW: 1.0, QUICK: 0.35, CLOSE: 0.25}
    for _ in range(batches):
        level = choice.level
        size = int(RAW_BYTES * ratios[level])
        if level is not RAW:
            choice.coded(level, RAW_BYTES, size, RAW_BYTES / (1e9 if level == QUICK else 0.6e9))
        at += size / rate
        choice.sent(RAW_BYTES, size, rate < float("inf"), at)
    return at


@pytest.mark.parametrize(("rate", "level"), [(10e6, CLOSE), (50e6, CLOSE), (400e6, QUICK), (5e9, RAW)])
def test_what_has_a_byte_at_its_end_soonest_is_chosen(rate: float, level: int | None) -> None:
    choice = CodingChoice()
    assert choice.level is RAW
    told(choice, rate, 40)
    assert choice.level == level


def test_a_link_that_gets_faster_or_slower_is_found_out() -> None:
    choice = CodingChoice()
    at = told(choice, 20e6, 20)
    assert choice.level == CLOSE
    told(choice, float("inf"), 2 + BYTES_WITHOUT_WAIT // RAW_BYTES, at)
    assert choice.level is RAW
    choice.begin_frame()
    told(choice, 20e6, 20, at + 60)
    assert choice.level == CLOSE


def test_a_pause_between_frames_is_not_taken_for_a_slow_link() -> None:
    choice = CodingChoice()
    at = told(choice, 5e9, 10)
    choice.begin_frame()
    told(choice, 5e9, 2, at + 100)
    assert choice.level is RAW
