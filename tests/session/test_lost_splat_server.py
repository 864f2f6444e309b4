"""Splat servers are killed while others draw: the refinement goes on, and the next complete image has all its bits."""

import random
import signal
import threading
from collections.abc import Iterator
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
from volsplat.protocol.description.scene import Image, Scene, Step
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.refinement import PAPER_STEPS

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
