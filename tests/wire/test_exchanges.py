"""Whose turn it is: every answer has a request, and what comes out of turn ends its connection and nothing else."""

import logging
from collections.abc import Iterator
from contextlib import suppress
from random import Random
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.files.head_volume import SIZE, skin
from support.messages.coordinated import (
    ASKED,
    JOINED,
    SPLAT,
    CheckedCoordinator,
    drawing,
    joins,
    lending,
    opened_store,
    surveyed,
)
from support.messages.decoded import decoded
from support.messages.message_samples import PART, SAMPLES
from support.patience import wait_until
from volsplat.client import Session
from volsplat.client.coordinator.events.events import MessageReceived, ServerLost, ServerProcessEnded
from volsplat.client.coordinator.events.instructions import FailSession, Instruction, Send
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.links.server_links import server_id
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.control_part import encode_control
from volsplat.protocol.messages.exchanges import EXCHANGES, Exchanges
from volsplat.protocol.messages.message import OTHERS_AT_ONCE, Message
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT, SPLAT_TO_CLIENT, Role, Way
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.messages.vocabulary import MESSAGES
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.text import rare_lines
from volsplat.protocol.text.errors import BadInput, RemoteProtocolError, VolsplatError
from volsplat.protocol.wire.accepting import IdCounter
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import HEADER, MAGIC, Decoder, encode
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.tokens import Token, new_token

WAYS = pytest.mark.parametrize("way", EXCHANGES, ids=str)
OTHER_PART = msgspec.structs.replace(PART, sub_cube=PART.sub_cube + 1)


def answers(way: Way) -> set[type[Message]]:
    """What a server may answer, but for Refused."""
    return {answer for kind in EXCHANGES[way].values() for answer in kind.answers}


UNANSWERED = (messages.NameSession, messages.InviteWorkers, messages.ImagesTaken, messages.Alive, messages.EndSession)


@WAYS
def test_every_message_between_client_and_server_is_a_request_or_an_answer(way: Way) -> None:
    there = {kind for kind in MESSAGES if way in kind.ways}
    back = {kind for kind in MESSAGES if way.back in kind.ways}
    assert there == set(EXCHANGES[way]) | there.intersection(UNANSWERED)
    assert back == answers(way) | {messages.Refused, messages.Alive, messages.LeaveSession}


@WAYS
def test_exchanges_are_told_apart_by_ids_alone(way: Way) -> None:
    for kind in EXCHANGES[way].values():
        assert set(kind.named_by) <= {"frame", "of_frame", "assignment", "question", "part", "reading"}


def test_a_trace_may_be_asked_for_while_a_later_frame_is_drawn() -> None:
    exchanges = Exchanges(CLIENT_TO_MAPSHADE)
    for frame in (1, 2):
        exchanges.said(msgspec.structs.replace(SAMPLES[messages.RenderFrame][0], frame=frame))
    exchanges.said(messages.ReadTrace(1))
    exchanges.said(msgspec.structs.replace(SAMPLES[messages.FrameMapped][0], frame=2))
    exchanges.check(messages.FrameTraced(1, [], 0))


@WAYS
def test_nothing_is_answered_unasked_and_nothing_twice(way: Way) -> None:
    for request, kind in EXCHANGES[way].items():
        asked = SAMPLES[request][0]
        ids = {key: getattr(asked, key) for key in kind.named_by}
        for n, answer_kind in enumerate(kind.answers):
            answer = msgspec.structs.replace(SAMPLES[answer_kind][0], **ids)
            if isinstance(answer, messages.ImageRead) and isinstance(asked, messages.RenderFrame):
                width, height = asked.drawing.plan.image_size
                answer = msgspec.structs.replace(answer, left=0, top=0, width=width, height=height)
            exchanges = Exchanges(way)
            with pytest.raises(ValueError, match=rf"^{answer_kind.__name__}.* came unasked$"):
                exchanges.check(answer)
            exchanges.said(asked)
            if n:
                with pytest.raises(ValueError, match="unasked"):
                    exchanges.check(answer)  # the image, before the frame is finished
                exchanges.said(msgspec.structs.replace(SAMPLES[messages.FrameFinished][0], **ids))
            for key, id in ids.items():
                other = msgspec.structs.replace(answer, **{key: id + 1 if isinstance(id, int) else OTHER_PART})
                with pytest.raises(ValueError, match="unasked"):
                    exchanges.check(other)
            exchanges.check(answer)
            exchanges.said(answer)
            with pytest.raises(ValueError, match="unasked"):
                exchanges.check(answer)


@WAYS
def test_a_refusal_ends_the_exchange_that_it_names_and_no_other(way: Way) -> None:
    for request in EXCHANGES[way]:
        asked = SAMPLES[request][0]
        ids: Any = {key: getattr(asked, key, 0) for key in ("frame", "assignment", "question")}
        refused = messages.Refused(request.__name__, "no", **ids)
        exchanges = Exchanges(way)
        for wrong in (refused, messages.Refused("EndSession", "no"), messages.Refused("\x1b[2J" * 100, "no")):
            with pytest.raises(ValueError, match=r"^Refused \(request=[^\x1b]* came unasked$"):
                exchanges.check(wrong)
        exchanges.said(asked)
        exchanges.check(refused)
        exchanges.said(refused)
        with pytest.raises(ValueError, match="unasked"):
            exchanges.check(refused)


def test_what_is_answered_of_a_frame_ends_what_was_owed_of_older_ones() -> None:
    exchanges = Exchanges(CLIENT_TO_SPLAT)
    for frame in (1, 2, 3):
        exchanges.said(msgspec.structs.replace(SAMPLES[messages.RenderFrame][0], frame=frame))
        exchanges.said(messages.ReadImage(frame))
    finished = SAMPLES[messages.FrameFinished][0]
    exchanges.check(msgspec.structs.replace(finished, frame=1))  # on its way when the newer ones were asked for
    exchanges.said(msgspec.structs.replace(finished, frame=2))
    for late in (
        msgspec.structs.replace(finished, frame=1),
        messages.ImageRead(1, Step.F, True, 0, 0, 1, 1, messages.RawPixels()),
    ):
        with pytest.raises(ValueError, match="unasked"):
            exchanges.check(late)
    exchanges.check(msgspec.structs.replace(finished, frame=3))


def test_an_image_of_another_size_than_was_asked_for_is_given_no_memory() -> None:
    exchanges = Exchanges(CLIENT_TO_SPLAT)
    render = SAMPLES[messages.RenderFrame][0]
    assert isinstance(render, messages.RenderFrame)
    for frame, side in ((1, 32), (2, 64)):
        plan = msgspec.structs.replace(render.drawing.plan, width=side, height=side)
        drawing = msgspec.structs.replace(render.drawing, plan=plan)
        exchanges.said(msgspec.structs.replace(render, frame=frame, drawing=drawing, regions=[Region(3, 0, side)]))
    exchanges.said(messages.ReadImage(2))
    allocated: list[int] = []

    def allocate(message: Message, nbytes: int) -> bytearray:
        allocated.append(nbytes)
        return bytearray(nbytes)

    for side in (65, 64, 16384):
        control = encode_control(messages.ImageRead(2, Step.F, False, 0, 0, side, side, messages.RawPixels()))
        head = HEADER.pack(MAGIC, len(control), side * side * 16) + control
        decoder = Decoder(Speech(SPLAT_TO_CLIENT, exchanges=exchanges), allocate)
        if side == 64:
            assert list(decoded(decoder, head)) == []
        else:
            told = rf"^ImageRead \(frame=2\) reaches to {side} x {side} pixels, but 64 x 64 were asked for$"
            with pytest.raises(RemoteProtocolError, match=told):
                list(decoded(decoder, head))
    assert allocated == [64 * 64 * 16]


def test_of_frames_that_are_over_no_sizes_are_kept() -> None:
    exchanges = Exchanges(CLIENT_TO_SPLAT)
    for frame in range(1, messages.MAX_SERVERS + 3):
        exchanges.said(msgspec.structs.replace(SAMPLES[messages.RenderFrame][0], frame=frame))
    assert len(exchanges._sizes) == messages.MAX_SERVERS
    exchanges.said(msgspec.structs.replace(SAMPLES[messages.FrameFinished][0], frame=frame))
    assert list(exchanges._sizes) == [frame]


@WAYS
def test_only_so_many_requests_wait(way: Way) -> None:
    for request, kind in EXCHANGES[way].items():
        asked, exchanges = SAMPLES[request][0], Exchanges(way)
        for n in range(kind.at_once + 1 if kind.newest else 0):
            (key,) = kind.named_by
            exchanges.said(msgspec.structs.replace(asked, **{key: n + 1}))
        assert len(exchanges._open[request]) <= kind.at_once
        exchanges = Exchanges(way)
        for _ in range(OTHERS_AT_ONCE if kind.newest else kind.at_once):
            exchanges.check(asked)
            exchanges.said(asked)
        with pytest.raises(ValueError, match=f"{request.__name__}.* came while too many before it wait"):
            exchanges.check(asked)


# -- the coordinator, fed with whatever its servers may say


def fed(coordinator: CheckedCoordinator, random: Random, events: int) -> None:
    """Any servers say anything, honest and not; what passes the table of turns must be taken without an error."""
    tables: dict[int, Exchanges] = {}

    def note(instructions: list[Instruction]) -> None:
        for instruction in instructions:
            if isinstance(instruction, Send) and not isinstance(instruction.message, UNANSWERED):
                tables[instruction.server].said(instruction.message)

    for number, joined in coordinator.servers.joined.items():
        tables[number] = Exchanges(CLIENT_TO_SPLAT if joined.role is Role.SPLAT_SERVER else CLIENT_TO_MAPSHADE)
    for _ in range(events):
        if not coordinator.servers.joined or coordinator.failure is not None:
            return
        server = random.choice(list(coordinator.servers.joined))
        kinds = answers(CLIENT_TO_SPLAT if server == SPLAT else CLIENT_TO_MAPSHADE) | {messages.Refused}
        message, payload = SAMPLES[random.choice(sorted(kinds, key=lambda kind: kind.__name__))]
        for key in ("frame", "assignment", "question"):
            if key in message.__struct_fields__:
                message = msgspec.structs.replace(message, **{key: random.randint(0, 3)})
        try:
            tables[server].check(message)
        except ValueError as error:
            note(coordinator.handle(ServerLost(server, str(error))))
            continue
        tables[server].said(message)
        note(coordinator.handle(MessageReceived(server, message, memoryview(payload), 0.0)))


@given(st.integers(0, 4), st.randoms(use_true_random=False))
def test_no_server_can_make_the_coordinator_raise(begun: int, random: Random) -> None:
    if begun == 0:
        coordinator = CheckedCoordinator()
        for event in [*joins(*JOINED), ASKED]:
            coordinator.handle(event)
    else:
        coordinator = (surveyed, drawing, lending, opened_store)[begun - 1]()
    fed(coordinator, random, 30)


# -- over sockets: a client with servers of its own, and a guest who holds the token


@pytest.fixture(scope="module")
def lasting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Session, SingleProcess, Token]]:
    path = tmp_path_factory.mktemp("head") / "head.mha"
    write_volume(path, *make_phantom("head", size=SIZE))
    token = new_token()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rare_lines, "MOST_AT_ONCE", len(MESSAGES) + rare_lines.MOST_AT_ONCE)  # a line on each guest
        with Session(path, workers=2, token=token) as session, SingleProcess(path) as single:
            session.volume  # noqa: B018
            yield session, single, token


def lies(connection: Connection, message: Message, payload: bytes) -> None:
    """Send what may not be said."""
    speech = Speech(
        Way(Role.SPLAT_SERVER if type(message) in answers(CLIENT_TO_SPLAT) else Role.MAPSHADE_SERVER, Role.CLIENT)
    )
    for buffer in encode(message, payload, speech=speech):
        with suppress(BrokenPipeError, ConnectionResetError):  # it was cut off by the control part
            connection._socket.sendall(buffer)


GUESTS = [
    (role, kind)
    for role, kinds in (
        (Role.MAPSHADE_SERVER, answers(CLIENT_TO_MAPSHADE) | {messages.Refused}),
        (Role.SPLAT_SERVER, answers(CLIENT_TO_SPLAT)),
    )
    for kind in kinds - {messages.MachineDescribed}  # which every server is asked for
]


@pytest.mark.parametrize(
    ("role", "kind"), sorted(GUESTS, key=str), ids=lambda each: getattr(each, "__name__", str(each))
)
def test_a_guest_who_speaks_out_of_turn_is_cut_off_and_the_session_goes_on(
    role: Role, kind: type[Message], lasting: tuple[Session, SingleProcess, Token], caplog: pytest.LogCaptureFixture
) -> None:
    session, single, token = lasting
    guest = connect(
        session.address, new_hello(role, data_port=7 if role is Role.SPLAT_SERVER else 0), token, Role.CLIENT
    )
    with guest:
        message, payload = SAMPLES[kind]
        lies(guest, message, payload)
        with pytest.raises(VolsplatError):
            while guest.receive():
                pass
    scene = skin(session)
    assert session.render(scene).equal(single.render(scene))

    def lines() -> list[str]:
        return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]

    wait_until(lines, "told why")
    (line,) = lines()
    assert f"{role} {guest.id} " in line and f"{kind.__name__}" in line
    assert line.endswith("came unasked; the connection is closed")


def test_guests_that_come_and_go_leave_nothing(lasting: tuple[Session, SingleProcess, Token]) -> None:
    session, _, token = lasting
    before = len(session.servers)
    for _ in range(20):
        with connect(session.address, new_hello(Role.MAPSHADE_SERVER), token, Role.CLIENT):
            pass
    wait_until(lambda: len(session.servers) <= before, "gone")


def test_no_more_servers_join_than_messages_can_name() -> None:
    hello, numbers = new_hello(Role.MAPSHADE_SERVER), IdCounter()
    assert server_id(hello, messages.MAX_SERVERS - 1, numbers) == 1
    with pytest.raises(BadInput, match="4096 servers have joined already"):
        server_id(hello, messages.MAX_SERVERS, numbers)


def test_a_failed_session_says_who_failed_it() -> None:
    """A worker that holds a part of the volume, and says of it what cannot be."""
    coordinator = CheckedCoordinator()
    for event in [*joins(*JOINED), ASKED]:
        coordinator.handle(event)
    cause = "splat server 1 broke the protocol: ImageRead came unasked"
    coordinator.handle(ServerLost(SPLAT, cause))
    failed = coordinator.handle(ServerProcessEnded(f"{cause}; the splat server ends again and again"))
    assert isinstance(failed[-1], FailSession) and str(failed[-1].error).startswith("splat server 1 broke")
