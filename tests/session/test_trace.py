"""A trace of a frame: rows of every process, spans that nest, moments that agree within what clocks are off."""

import os
import threading
import time
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest
import torch

from support.files.head_volume import head, scene, single, skin
from support.files.small_disks import fill, small_disk
from support.files.trace_file import Event, Trace
from support.patience import PATIENCE
from volsplat.client import Session
from volsplat.client.session.asked_frames import FrameGivenUp
from volsplat.client.session.single import SingleProcess
from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.client.trace.server_clocks import ServerClock
from volsplat.program.frame_spans import FrameSpans
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.trace_messages import MOST_SPANS, ClockRead, FrameTraced, ReadClock, ReadTrace, Span
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address

__all__ = ["head", "scene", "single", "small_disk"]

NO_UNIX_SOCKET = Address("127.0.0.2", 0)  # stands beside that


def nest(spans: list[Event]) -> bool:
    """Whether any two lie apart or one in the other."""
    open_until: list[int] = []
    moments = [(round(1000 * span["ts"]), round(1000 * (span["ts"] + span["dur"]))) for span in spans]  # nanoseconds
    for begin, end in sorted(moments, key=lambda span: (span[0], -span[1])):
        while open_until and open_until[-1] <= begin:
            open_until.pop()
        if open_until and end > open_until[-1]:
            return False
        open_until.append(end)
    return True


@pytest.fixture(scope="module")
def path(head: Path, single: SingleProcess, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of two frames by 2 map/shade and 2 splat servers, which the client reaches by encrypted TCP, as elsewhere."""
    path = tmp_path_factory.mktemp("traces") / "trace.json"
    look = skin(single)
    with Session(head, workers=2, splat_servers=2, threads=4, listen=NO_UNIX_SOCKET, tls=True, trace=path) as session:
        for step in (Step.C, Step.F, Step.G):
            assert torch.equal(session.render(look, step), single.render(look, step))
    return path


def test_every_process_has_its_rows(path: Path) -> None:
    trace = Trace(path)
    for frame in (1, 2):
        for server in (1, 2, 3, 4):
            (role,) = (name.partition(" (")[0] for name in trace.names.values() if f"server {server} " in name)
            if role.startswith("map/shade"):
                assert {"walk"} < {span["name"] for span in trace.of(role, "walker", frame)}
            else:
                assert {"merge", "splat", "wait"} <= {span["name"] for span in trace.of(role, "owner", frame)}
                assert {"take"} <= {span["name"] for span in trace.of(role, "from map/shade", frame)}
                assert "send image" in {span["name"] for span in trace.of(role, "to client", frame)}
            assert {"plan", "wait for its turn"} <= {span["name"] for span in trace.of(role, "requests", frame)}
            assert {"RenderFrame"} <= {span["name"] for span in trace.of("client", f"to {role}", frame)}
        assert [span["name"] for span in trace.of("client", "coordinator", frame)] == ["plan"]
        assert len(trace.of("client", "caller", frame)) == 1


def test_spans_of_a_row_nest(path: Path) -> None:
    for (process, row), spans in Trace(path).rows.items():
        assert nest(spans), (process, row, spans)


def test_the_servers_work_lies_between_the_clients_ask_and_the_images_arrival(path: Path) -> None:
    trace = Trace(path)
    for frame in (1, 2):
        (asked,) = trace.of("client", "caller", frame)
        for process in trace.names.values():
            if process == "client":
                continue
            (drawn,) = (s for s in trace.of(process, "requests", frame) if s["name"] == f"frame {frame}")
            sent = [s for s in trace.of("client", f"to {process.partition(' (')[0]}", frame)]
            off = trace.error(process)
            assert asked["ts"] - off <= sent[0]["ts"] <= drawn["ts"] + off
            assert drawn["ts"] + drawn["dur"] <= asked["ts"] + asked["dur"] + off
        came = [s for s in trace.of("client", "from splat server", frame) if s["name"] == "ImageRead"]
        assert len(came) == 2


def test_frames_that_threads_take_from_each_other_are_traced_without_a_loss(
    head: Path, scene: Scene, tmp_path: Path
) -> None:
    losses: list[str] = []
    with Session(head, workers=2, trace=tmp_path / "trace.json", on_loss=losses.append) as session:

        def draw(pauses: Random) -> None:
            for _ in range(60):
                with suppress(FrameGivenUp):
                    session.render(scene)
                threading.Event().wait(pauses.uniform(0.0, 0.02))  # so that they overtake each other anywhere

        drawing = [threading.Thread(target=draw, args=(Random(seed),)) for seed in range(2)]
        for thread in drawing:
            thread.start()
        for thread in drawing:
            thread.join(PATIENCE)
        assert not losses and not any(thread.is_alive() for thread in drawing)


def test_the_single_process_has_rows_of_its_owners_any_of_whom_may_walk(
    head: Path, scene: Scene, tmp_path: Path
) -> None:
    with SingleProcess(head, threads=2, trace=tmp_path / "trace.json") as traced:
        traced.render(scene)
    trace = Trace(tmp_path / "trace.json")
    owners = [{span["name"] for span in trace.of("client", f"owner {owner}", 1)} for owner in range(2)]
    assert all({"merge", "splat"} <= stages for stages in owners)
    assert any("walk" in stages for stages in owners)
    assert all(map(nest, trace.rows.values()))


def test_without_a_wish_nothing_is_noted() -> None:
    spans = FrameSpans(7)
    spans.note("row", "name", 1.0, 2.0)
    assert spans.told(7) == FrameTraced(7, [], 0)


def test_more_spans_than_a_message_holds_are_counted() -> None:
    spans = FrameSpans(7, wanted=True)
    for n in range(MOST_SPANS + 3):
        spans.note("walker 0", "send to splat server 2", n, n + 1)
    assert (len(spans.told(7).spans), spans.told(7).left_out) == (MOST_SPANS, 3)
    assert spans.told(6).spans == []


def test_the_reading_with_the_shortest_round_trip_counts() -> None:
    clock = ServerClock()
    assert clock.best is None
    clock.read(asked=10.0, shown=1000.0, heard=10.5)
    clock.read(asked=11.0, shown=1001.0, heard=11.125)
    assert clock.best == (-989.9375, 0.0625)


def test_a_server_that_is_lost_is_not_waited_for_and_clocks_of_other_epochs_are_aligned(tmp_path: Path) -> None:
    tracer = FrameTracer(tmp_path / "trace.json")

    def answering(message: Message) -> None:
        """A server whose clock is 500 s ahead."""
        match message:
            case ReadClock():
                tracer.take(1, ClockRead(time.perf_counter() + 500.0), time.perf_counter())
            case ReadTrace(of_frame=frame):
                began = time.perf_counter() + 500.0
                tracer.take(1, FrameTraced(frame, [Span("row", "work", began, began)], 0), time.perf_counter())

    tracer.joined(1, "one", answering)
    tracer.joined(2, "two", lambda message: tracer.lost(2) if message == ReadClock() else None)
    tracer.note(9, "caller", "frame 9", *[time.perf_counter()] * 2)
    tracer.finish(9)
    tracer.close()
    trace = Trace(tmp_path / "trace.json")
    (work,), (asked,) = trace.of("one", "row", 9), trace.of("client", "caller", 9)
    assert 0.0 <= work["ts"] - asked["ts"] < 60e6


def test_what_a_clock_may_be_off_holds_for_every_frame(tmp_path: Path) -> None:
    """Each has the best of the newest readings, which may be better later."""
    tracer, round_trips = FrameTracer(tmp_path / "trace.json"), {1: 0.5, 2: 0.0}

    def answering(message: Message) -> None:
        now = time.perf_counter()
        match message:
            case ReadClock():
                tracer.take(1, ClockRead(now), now + round_trips[min(round_trips)])
            case ReadTrace(of_frame=frame):
                tracer.take(1, FrameTraced(frame, [], 0), now)

    tracer.joined(1, "one", answering)
    for frame in list(round_trips):
        tracer.finish(frame)
        del round_trips[frame]
    tracer.close()
    trace = Trace(tmp_path / "trace.json")
    assert all(0.25e6 <= trace.error(name) < 0.5e6 for name in trace.names.values() if name != "client")


def test_what_is_noted_before_a_servers_answer_belongs_to_the_frame(tmp_path: Path) -> None:
    """Who sent the request may be kept from noting so until the frame is over."""
    tracer = FrameTracer(tmp_path / "trace.json")

    def answering(message: Message) -> None:
        match message:
            case ReadClock():
                tracer.take(1, ClockRead(time.perf_counter()), time.perf_counter())
            case ReadTrace(of_frame=frame):
                tracer.note(frame, "to one", "RenderFrame", *[time.perf_counter()] * 2)
                tracer.take(1, FrameTraced(frame, [], 0), time.perf_counter())

    tracer.joined(1, "one", answering)
    tracer.finish(9)
    tracer.close()
    assert [span["name"] for span in Trace(tmp_path / "trace.json").of("client", "to one", 9)] == ["RenderFrame"]


def test_who_is_asked_within_may_note_from_another_thread(tmp_path: Path) -> None:
    """As whoever sends to a server while another one is sending to it."""
    tracer, noted = FrameTracer(tmp_path / "trace.json"), threading.Event()

    def asked(message: Message) -> None:
        def note() -> None:
            tracer.note(9, "to one", "RenderFrame", 0.0, 0.0)
            noted.set()

        threading.Thread(target=note, daemon=True).start()
        assert noted.wait(PATIENCE)

    tracer.joined(1, "one", asked)
    assert noted.is_set()
    tracer.close()


def test_a_trace_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot write the trace"):
        FrameTracer(tmp_path)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_keeps_no_trace_that_tells_nothing_and_one_that_tells_something(small_disk: Path) -> None:
    fill(small_disk)
    with pytest.raises(BadInput, match="trace.json: cannot write the trace: No space left on device; name another"):
        FrameTracer(small_disk / "trace.json")
    assert os.listdir(small_disk) == ["filler"]
    (small_disk / "filler").unlink()
    tracer = FrameTracer(small_disk / "trace.json")
    tracer.note(1, "main", "draw", 0.0, 1.0)
    tracer.finish(1)
    fill(small_disk)
    with pytest.raises(BadInput, match="No space left on device"):
        for _ in range(100):
            tracer.note(2, "main", "draw", 0.0, 1.0)
            tracer.finish(2)
    assert b'"draw"' in (small_disk / "trace.json").read_bytes()


def test_a_full_disk_is_told_in_one_line() -> None:
    with pytest.raises(BadInput, match="No space left"):
        FrameTracer(Path("/dev/full"))
