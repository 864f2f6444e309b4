"""Sessions with real servers on real sockets: refinement, newest frame wins, losses."""

import gc
import logging
import re
import signal
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
import psutil
import pytest
import torch

import volsplat
from support.files.head_volume import head, single, skin
from support.messages.message_samples import SAMPLES
from support.patience import PATIENCE, wait_until
from support.programs.server_processes import is_server
from tolerances import ROUNDING
from volsplat.client import Session
from volsplat.client.coordinator.events.instructions import EndFrame
from volsplat.client.session import asked_images, coordination
from volsplat.client.session import single as single_process
from volsplat.client.session.asked_frames import AskedFrames, next_image
from volsplat.client.session.frame_report import report_of
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Bounds, Image, Order, Quantise
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.message import LARGEST_ID
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError
from volsplat.protocol.wire import buffer_pool

__all__ = ["head", "single"]

NAMES = {"mapshade_server": "map/shade server", "splat_server": "splat server"}


@pytest.fixture(scope="module")
def session(head: Path) -> Iterator[Session]:
    with Session(head, workers=3) as session:
        yield session


def test_a_session_and_a_single_process_know_the_same_of_a_volume(session: Session, single: SingleProcess) -> None:
    assert session.volume == single.volume


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("step", Step)
def test_every_step_is_the_same_distributed_and_single(
    session: Session, single: SingleProcess, order: Order, step: Step
) -> None:
    scene = msgspec.structs.replace(skin(session), order=order)
    image = session.render(scene, step)
    assert image.shape == (80, 96, 4) and image.dtype == torch.float32
    assert image[..., 3].max() > 0
    assert torch.equal(image, single.render(scene, step))


def test_step_g_tells_what_its_splatting_went_into(session: Session, single: SingleProcess) -> None:
    renderers: list[Session | SingleProcess] = [session, single]
    for renderer in renderers:
        *_, f, g = (drawn for drawn in renderer.refine(skin(renderer), Step.G) if drawn.outcome is not None)
        report = report_of(renderer.volume, skin(renderer), [one.outcome for one in (f, g) if one.outcome])
        assert report.steps[0].slabs is None
        told = report.steps[1]
        assert told.slabs is not None
        stages = msgspec.structs.astuple(told.slabs)
        assert min(stages) > 0 and sum(stages) <= told.splat_seconds * (1 + ROUNDING)


def test_shadows_and_occlusion_are_the_same_distributed_and_single(session: Session, single: SingleProcess) -> None:
    plain = skin(session)
    light = msgspec.structs.replace(plain.light, shadows=0.8, occlusion=0.6)
    scene = msgspec.structs.replace(plain, light=light)
    bare = session.render(plain, Step.G)
    for turn in ((0.0, 0.0, 0.0, 1.0), (0.1, 0.2, 0.3, 0.9)):
        scene = msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, rotation=turn))
        assert torch.equal(session.render(scene, Step.G), single.render(scene, Step.G))
    scene = msgspec.structs.replace(scene, view=plain.view)
    image = session.render(scene, Step.G)
    assert torch.equal(image, single.render(scene, Step.G))
    assert torch.equal(image[..., 3], bare[..., 3])
    assert 0 < image[..., :3].sum() < 0.99 * bare[..., :3].sum()
    assert torch.equal(session.render(scene), session.render(plain))  # step F


def test_refinement_yields_the_finished_steps_in_order(session: Session) -> None:
    scene = skin(session)
    refinements = list(session.refine(scene, partial_interval=0.0001))
    finished = [refinement for refinement in refinements if refinement.complete]
    assert [refinement.step for refinement in finished] == list(PAPER_STEPS)
    assert [r.step for r in refinements] == sorted(r.step for r in refinements)
    assert torch.equal(finished[-1].image, session.render(scene))
    for refinement in finished:
        assert refinement.outcome is not None and len(refinement.outcome.servers.map_shade) == 3


def test_refinement_may_begin_and_end_at_any_step(session: Session, single: SingleProcess) -> None:
    renderers: list[Session | SingleProcess] = [session, single]
    for renderer in renderers:
        drawn = list(renderer.refine(skin(renderer), first=Step.C, last=Step.D, partial_interval=1e9))
        assert [refinement.step for refinement in drawn] == [Step.C, Step.D]
        assert torch.equal(drawn[0].image, single.render(skin(single), Step.C))


@pytest.mark.parametrize("kind", [Session, SingleProcess])
def test_who_waits_is_told_how_far_a_frame_is(
    head: Path, kind: type[Session] | type[SingleProcess], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asked_images, "PROGRESS_SECONDS", 0.001)
    monkeypatch.setattr(single_process, "PROGRESS_SECONDS", 0.001)
    said: list[str] = []
    with kind(head, threads=1, on_progress=said.append) as renderer:
        scene = skin(renderer, Image(width=512, height=512))
        wait_until(lambda: renderer.finish(scene, Step.G) and any("%" in line for line in said), "told")
    shares = [int(found[1]) for line in said if (found := re.fullmatch(r"step G: (\d+) %", line))]
    assert shares and all(0 <= share <= 100 for share in shares)


def test_a_partial_image_lies_over_the_finished_step_before(single: SingleProcess) -> None:
    drawn = list(single.refine(skin(single, Image(width=700, height=700)), Step.B, partial_interval=0.0))
    (finished,) = [r.image[..., 3] for r in drawn if r.complete and r.step == Step.A]
    for partial in (r.image[..., 3] for r in drawn if not r.complete and r.step == Step.B):
        assert torch.all(partial >= finished)


def test_a_newer_frame_ends_the_refinement_that_runs(session: Session) -> None:
    scene = skin(session)
    refinement = session.refine(scene)
    assert next(refinement).step == Step.A
    newer = session.render(msgspec.structs.replace(scene, order=Order.FRONT_TO_BACK))
    assert newer.shape == (80, 96, 4)
    assert list(refinement) == []


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("partial_interval", [0.0, 1e9], ids=["within a step", "between two steps"])
def test_a_frame_beside_a_refinement_of_the_single_process_ends_it_and_is_whole(
    head: Path, threads: int, partial_interval: float
) -> None:
    with SingleProcess(head, threads=threads) as single:
        scene = skin(single, Image(width=300, height=300))
        other = msgspec.structs.replace(scene, order=Order.BACK_TO_FRONT)
        alone = single.render(other)
        refinement = single.refine(scene, partial_interval=partial_interval)
        next(refinement)
        assert torch.equal(single.render(other), alone)
        assert list(refinement) == []


def test_abort_ends_what_runs_and_the_session_goes_on(session: Session) -> None:
    refinement = session.refine(skin(session, Image(width=900, height=900)), partial_interval=0.001)
    seen = next(r for r in refinement if r.step == Step.C)
    session.abort()
    rest = list(refinement)
    assert all(r.step == seen.step for r in rest), "a step that was done before the abort came may still be told"
    assert session.render(skin(session)).shape == (80, 96, 4)


def test_another_window_is_packed_anew_and_back(session: Session, single: SingleProcess) -> None:
    scene = skin(session)
    narrow = msgspec.structs.replace(scene, quantise=Quantise(window=(500.0, 1500.0), directions="paper"))
    first, changed, again = session.render(scene), session.render(narrow), session.render(scene)
    assert torch.equal(first, again) and not torch.equal(first, changed)
    assert torch.equal(changed, single.render(narrow))


def test_bounds_outside_the_volume_are_refused_and_the_session_goes_on(session: Session) -> None:
    scene = skin(session)
    with pytest.raises(BadInput, match="bounds on j"):
        session.render(msgspec.structs.replace(scene, bounds=Bounds(low=(0, 99, 0))))
    assert session.render(scene)[..., 3].max() > 0


def test_a_closed_session_says_so(head: Path) -> None:
    session = Session(head, workers=1)
    scene = skin(session)
    session.close()
    session.close()
    with pytest.raises(VolsplatError, match="closed"):
        session.render(scene)


def test_a_volume_that_cannot_be_read_is_bad_input(tmp_path: Path) -> None:
    with Session(tmp_path / "missing.nrrd", workers=1) as session:
        with pytest.raises(BadInput, match="missing.nrrd"):
            session.volume  # noqa: B018


def test_a_frame_that_gives_way_ends_by_an_error_that_scripts_have_and_that_tells_the_cure() -> None:
    frames = AskedFrames()
    number, answers = frames.ask()
    frames.supersede()
    frames.give(EndFrame(number))
    with pytest.raises(volsplat.FrameGivenUp, match="frame 1 .* gave way to a newer one; ask again") as aborted:
        next_image(answers, PATIENCE)
    with pytest.raises(volsplat.FrameGivenUp, match="gave way to a newer frame; ask again"):
        frames.ask(after=number)
    assert isinstance(aborted.value, VolsplatError)


@pytest.mark.parametrize("victim", ["mapshade_server", "splat_server"])
@pytest.mark.parametrize("moment", ["header", "reading", "histograms", "packets", "step"])
def test_a_server_may_die_at_any_moment_and_all_is_drawn(
    head: Path, single: SingleProcess, victim: str, moment: str
) -> None:
    sessions: list[Session] = []
    killed: list[int] = []

    def kill(text: str) -> None:
        if moment in text and sessions and not killed:
            servers = [psutil.Process(pid) for pid in sessions[0].server_processes]
            server = next(one for one in servers if is_server(one, victim))
            killed.append(server.pid)
            server.send_signal(signal.SIGKILL)

    with Session(head, workers=2, on_progress=kill) as session:
        sessions.append(session)
        wait_until(lambda: session.render(skin(session)) is not None and bool(killed), "is a server killed")
        assert torch.equal(session.render(skin(session)), single.render(skin(single)))


@pytest.mark.parametrize("logged", [True, False])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # of what cannot be logged
def test_whoever_waits_hears_of_a_mistake_inside(head: Path, logged: bool) -> None:
    def fails(record: logging.LogRecord) -> bool:
        return logged or 1 // 0 > 0

    logger = logging.getLogger(coordination.__name__)
    logger.addFilter(fails)
    try:
        with Session(head, workers=1, spawn=False) as session:
            session._coordination.tell("no event")  # type: ignore[arg-type]
            with pytest.raises(VolsplatError, match="the session cannot go on: KeyError"):
                session.volume  # noqa: B018
    finally:
        logger.removeFilter(fails)


def test_a_mistake_of_the_callers_is_logged_and_the_session_goes_on(
    head: Path, single: SingleProcess, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(text: str) -> None:
        raise RuntimeError("a progress bar broke")

    with Session(head, workers=2, on_progress=fail, on_loss=fail) as session:
        assert torch.equal(session.render(skin(session)), single.render(skin(single)))
        psutil.Process(session.server_processes[0]).kill()
        wait_until(lambda: any(server.lost for server in session.servers), "is a server lost")
        assert torch.equal(session.render(skin(session)), single.render(skin(single)))
    assert "a progress bar broke" in caplog.text and "on_progress or on_loss has failed at: " in caplog.text


def test_an_image_that_the_memory_does_not_hold_is_waited_for_by_nobody(
    head: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_memory(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("volsplat.client.session.links.image_receiver.ReadBlocks", no_memory)
    with Session(head, workers=1) as session:
        with pytest.raises(PeerLost, match="the memory does not suffice for what splat server .* sends; ask for"):
            session.render(skin(session))


def test_nobody_waits_for_the_end_of_workers_that_have_gone_on_to_a_newer_frame(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.render(skin(session))
    waited_for: list[str] = []

    def told_ends(names: list[str]) -> dict[str, str]:
        waited_for.extend(names)
        return {}

    monkeypatch.setattr(session._links._local, "told_ends", told_ends)
    worker = next(server.id for server in session.servers if server.role is Role.MAPSHADE_SERVER)
    sample = SAMPLES[messages.FrameFinished][0]
    newest = session._coordination.frames.newest
    for frame, times in ((newest - 1, 0), (newest, 1)):
        finished = msgspec.structs.replace(sample, frame=frame, complete=False, lost=[worker])
        assert isinstance(finished, messages.FrameFinished)
        assert list(session._links._ends.told(finished)) == []
        assert len(waited_for) == times


def test_a_refinement_that_nobody_finishes_is_forgotten_and_aborted(session: Session) -> None:
    for _ in session.refine(skin(session)):
        break
    gc.collect()
    assert session.render(skin(session)).shape == (80, 96, 4)
    assert session._coordination.frames._answers == {}


def test_the_last_frame_that_has_a_number_is_drawn_and_more_are_refused_in_true_words(
    head: Path, single: SingleProcess
) -> None:
    with Session(head, workers=1) as session:
        session._coordination.frames._newest = LARGEST_ID - 1
        assert torch.equal(session.render(skin(session)), single.render(skin(single)))
        session.abort()
        with pytest.raises(BadInput, match=r"has had 2147483647 frames .*; open the volume anew$"):
            session.render(skin(session))
        assert session.failure is None


def test_a_closed_session_that_is_kept_holds_no_memory_that_images_came_in(head: Path) -> None:
    came_in = tracemalloc.Filter(True, buffer_pool.__file__)
    tracemalloc.start()
    try:
        with Session(head, workers=1, tls=True) as session:  # images come through the network
            session.finish(skin(session))
        assert session.failure is not None
        kept = tracemalloc.take_snapshot().filter_traces([came_in]).traces
        assert sum(trace.size for trace in kept) < buffer_pool.SMALLEST
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("thread", ["receive from map/shade", "send to map/shade"])
def test_a_server_for_which_there_is_no_thread_is_waited_for_by_nobody(
    head: Path, monkeypatch: pytest.MonkeyPatch, thread: str
) -> None:
    start = threading.Thread.start

    def starts(self: threading.Thread) -> None:
        if self.name.startswith(thread):
            raise RuntimeError("can't start new thread")
        start(self)

    monkeypatch.setattr(threading.Thread, "start", starts)
    with Session(head, workers=1) as session:
        with pytest.raises(PeerLost, match="the map/shade server .* ended"):
            session.volume  # noqa: B018


def test_no_workers_are_bad_input(head: Path) -> None:
    with pytest.raises(BadInput, match="workers must be 1 or more, not 0"):
        Session(head, workers=0)


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")  # Python's, from 3.12 on
@pytest.mark.parametrize("renderer", ["session", "single"])
def test_a_forked_process_is_told_to_open_its_own_and_takes_nothing_from_its_parent(
    renderer: str, request: pytest.FixtureRequest
) -> None:
    opened: Session | SingleProcess = request.getfixturevalue(renderer)
    whole = opened.render(skin(opened))
    steps = opened.refine(skin(opened), partial_interval=PATIENCE)
    next(steps)

    def use_it(told: Connection) -> None:
        for used in (lambda: next(steps), lambda: opened.render(skin(opened))):
            try:
                used()
            except BadInput as error:
                told.send(str(error))
        opened.close()

    told, tells = Pipe()
    forked = get_context("fork").Process(target=use_it, args=(tells,), daemon=True)
    forked.start()
    for _ in range(2):
        assert told.poll(PATIENCE) and "open it anew in each process" in told.recv()
    forked.join(PATIENCE)
    assert forked.exitcode == 0
    assert torch.equal(opened.render(skin(opened)), whole)


def test_a_closed_single_process_holds_nothing_and_says_that_it_is_closed(head: Path) -> None:
    single = SingleProcess(head)
    scene = single.volume.default_scene()
    assert single.finish(scene).complete and single._held.packed_bytes
    single.close()
    single.close()
    assert single._held.packed_bytes == 0
    for ask in (single.finish, lambda scene: list(single.refine(scene)), lambda scene: single.probe(scene, 1, 1)):
        with pytest.raises(PeerLost, match="^the session is closed$"):
            ask(scene)


GIVEN_BACK = """
import sys
import psutil
from volsplat.client.session.single import SingleProcess

single, taken = SingleProcess(sys.argv[1]), psutil.Process().memory_info
assert single.finish(single.volume.default_scene().with_(size=2000)).complete
open_bytes = taken().rss
single.close()
print(open_bytes - taken().rss)
"""


def test_a_closed_single_process_gives_the_memory_of_its_image_back(head: Path) -> None:
    """In a process where nothing else takes any, or gives it back."""
    command = [sys.executable, "-c", GIVEN_BACK, str(head)]
    told = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=PATIENCE, check=True).stdout
    assert int(told) >= 2 * 2000 * 2000 * 16  # as float32 RGBA: where it is drawn, and as it is handed out


def test_what_a_single_process_is_drawing_ends_once_it_is_closed(head: Path) -> None:
    begun = threading.Event()
    single = SingleProcess(head, on_progress=lambda words: begun.set() if words == "step F" else None)
    scene = single.volume.default_scene().with_(size=2000)
    with ThreadPoolExecutor(1) as thread:
        finished = thread.submit(single.finish, scene)
        assert begun.wait(PATIENCE)
        single.close()
        with pytest.raises(PeerLost, match="^the session is closed$"):
            finished.result(PATIENCE)


def test_a_refinement_that_a_caller_goes_on_with_ends_if_its_single_process_was_closed(head: Path) -> None:
    single = SingleProcess(head)
    left = single.refine(single.volume.default_scene().with_(size=2000), first="F", partial_interval=0.0)
    assert not next(left).complete
    single.close()
    with pytest.raises(PeerLost, match="^the session is closed$"):
        next(left)
