"""Splat servers are killed while others draw: the refinement goes on, and the next complete image has all its bits."""

import queue
import random
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import psutil
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.patience import PATIENCE, wait_until
from support.programs.server_processes import is_server
from volsplat.client import Session
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError

__all__ = ["head", "scene", "single"]

BIG = Image(width=500, height=400)  # so that there is time to be killed in
LONGEST_WAIT = 0.3  # seconds, before one is killed


def splat_processes(session: Session) -> list[psutil.Process]:
    processes = [psutil.Process(pid) for pid in session.server_processes if psutil.pid_exists(pid)]
    alive = [one for one in processes if one.status() != psutil.STATUS_ZOMBIE]
    return [process for process in alive if is_server(process, "splat_server")]


@contextmanager
def killed_after(process: psutil.Process, seconds: float, by: signal.Signals) -> Iterator[None]:
    """A splat server is ended while what is within runs, or right after it."""
    timer = threading.Timer(seconds, lambda: process.send_signal(by))
    timer.start()
    try:
        yield
    finally:
        timer.join()


@pytest.mark.parametrize("moment", ["header", "reading", "histograms", "packets", "step"])
def test_killed_while_the_volume_is_opened_it_is_done_without(
    head: Path, single: SingleProcess, scene: Scene, moment: str
) -> None:
    sessions: list[Session] = []
    killed: list[psutil.Process] = []

    def kill(text: str) -> None:
        if moment in text and sessions and not killed and len(processes := splat_processes(sessions[0])) == 3:
            killed.append(processes[0])
            processes[0].kill()

    with Session(head, workers=2, splat_servers=3, on_progress=kill) as session:
        sessions.append(session)
        for _ in range(3):
            assert torch.equal(session.render(scene), single.render(scene))


@pytest.mark.parametrize("seed", [random.randrange(10**9) for _ in range(4)], ids=lambda seed: "random moment")
def test_killed_at_any_moment_the_refinement_ends_whole_and_so_does_a_script_s_frame(
    head: Path, single: SingleProcess, scene: Scene, seed: int
) -> None:
    print(f"seed {seed}")
    chance = random.Random(seed)
    scene = msgspec.structs.replace(scene, image=BIG)
    drawn = {step: single.render(scene, step) for step in PAPER_STEPS}
    said: list[str] = []
    with Session(head, workers=2, splat_servers=4, threads=5, on_loss=said.append) as session:
        session.render(scene, Step.A)
        for _ in range(3):
            victim = chance.choice(splat_processes(session))
            with killed_after(victim, chance.uniform(0.0, LONGEST_WAIT), signal.SIGKILL):
                if chance.random() < 0.5:
                    steps = [one for one in session.refine(scene, partial_interval=0.01) if one.complete]
                    assert [one.step for one in steps] == list(PAPER_STEPS)
                    for refinement in steps:
                        assert torch.equal(refinement.image, drawn[refinement.step])
                else:
                    assert torch.equal(session.render(scene), drawn[Step.F])
            victim.wait(PATIENCE)
            assert torch.equal(session.render(scene), drawn[Step.F])
        lost = [server for server in session.servers if server.lost]
        assert {server.role for server in lost} == {Role.SPLAT_SERVER}
        assert len(said) == len(lost)
        assert all("take over its part of the image" in line for line in said)
        wait_until(lambda: len(splat_processes(session)) == 4, "are others started in their place")


def told_of_a_loss(head: Path, act: Callable[[Session], object]) -> tuple[Session, object]:
    """A session that has lost a splat server, and what `act` returned or raised when it was told of that."""
    done: queue.SimpleQueue[object] = queue.SimpleQueue()

    def tell(loss: str) -> None:
        try:
            done.put(act(session))
        except VolsplatError as error:
            done.put(error)

    session = Session(head, workers=1, splat_servers=2, threads=3, on_loss=tell)
    session.volume  # noqa: B018  waited for
    splat_processes(session)[0].kill()
    return session, done.get(timeout=PATIENCE)


def test_whoever_is_told_of_a_loss_may_close_the_session(head: Path, caplog: pytest.LogCaptureFixture) -> None:
    processes: list[psutil.Process] = []

    def close(session: Session) -> bool:
        processes.extend(map(psutil.Process, session.server_processes))
        session.close()
        return any(process.is_running() and process.status() != psutil.STATUS_ZOMBIE for process in processes)

    session, some_are_left = told_of_a_loss(head, close)
    assert processes and not some_are_left
    session.close()
    with pytest.raises(PeerLost, match="the session is closed"):
        session.render(session.default_scene())
    assert "cannot go on" not in caplog.text


@pytest.mark.parametrize(
    "wait",
    [
        lambda session: session.render(session.default_scene()),
        lambda session: next(iter(session.refine(session.default_scene()))),
        lambda session: session.probe(session.default_scene(), 1, 1),
        lambda session: session.file_voxel((0, 0, 0)),
    ],
)
def test_what_would_wait_for_the_thread_that_tells_of_a_loss_is_refused_there(
    head: Path, single: SingleProcess, scene: Scene, wait: Callable[[Session], object]
) -> None:
    session, error = told_of_a_loss(head, wait)
    with session:
        assert isinstance(error, BadInput) and "hand this to another thread" in str(error)
        assert torch.equal(session.render(scene), single.render(scene))


def test_closing_from_two_threads_at_once_ends(head: Path) -> None:
    """Also if the one waits for the other, which tells of a loss meanwhile."""
    closing = threading.Event()

    def close(session: Session) -> None:
        def begin() -> None:
            closing.set()
            session.close()

        threading.Thread(target=begin, daemon=True).start()
        assert closing.wait(PATIENCE)
        session.close()

    session, error = told_of_a_loss(head, close)
    session.close()
    assert error is None and not any(process.is_running() for process in map(psutil.Process, session.server_processes))
