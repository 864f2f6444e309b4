"""Servers that are frozen are noticed by their silence, and others take over; one that is only slow is not."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.patience import PATIENCE, wait_until
from volsplat.client import Session
from volsplat.client.session.silence import SilenceWatch
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost

__all__ = ["head", "scene", "single"]

BRIEF = 1.0  # seconds of silence


def servers(session: Session, program: str) -> list[psutil.Process]:
    processes = [psutil.Process(pid) for pid in session.server_processes]
    return [one for one in processes if f"volsplat.{program}" in one.cmdline()]


@contextmanager
def frozen(process: psutil.Process) -> Iterator[None]:
    process.suspend()
    wait_until(lambda: process.status() == psutil.STATUS_STOPPED, "does it stop")
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


def test_a_frozen_map_shade_server_is_lost_and_the_others_draw_all(
    head: Path, single: SingleProcess, scene: Scene
) -> None:
    with Session(head, workers=3, silence=BRIEF) as session:
        session.render(scene)
        with frozen(servers(session, "mapshade_server")[1]):
            assert torch.equal(session.render(scene), single.render(scene))
            (lost,) = [server for server in session.servers if server.lost]
            assert "has said nothing for 1 s: it is frozen, overloaded or cut off" in lost.cause and lost.handed_over
        assert torch.equal(session.render(scene), single.render(scene)), "though it may speak again"


def test_of_two_splat_servers_one_that_is_frozen_is_done_without(
    head: Path, single: SingleProcess, scene: Scene
) -> None:
    with Session(head, workers=2, splat_servers=2, silence=BRIEF) as session:
        session.render(scene)
        with frozen(servers(session, "splat_server")[0]):
            assert torch.equal(session.render(scene), single.render(scene))
            assert [server.role for server in session.servers if server.lost] == [Role.SPLAT_SERVER]


def test_who_waits_for_the_only_splat_server_hears_that_it_is_frozen(head: Path, scene: Scene) -> None:
    with Session(head, workers=1, silence=BRIEF) as session:
        session.render(scene)
        with frozen(servers(session, "splat_server")[0]), pytest.raises(PeerLost, match="has said nothing for 1 s"):
            session.render(scene)


@pytest.mark.parametrize("program", ["mapshade_server", "splat_server"])
def test_while_nobody_draws_a_frozen_server_is_noticed_as_well(head: Path, scene: Scene, program: str) -> None:
    with Session(head, workers=2, splat_servers=2, silence=BRIEF) as session:
        session.render(scene)
        with frozen(servers(session, program)[0]):
            wait_until(lambda: any(server.lost for server in session.servers), "is it noticed")


class Line:
    """A connection to a server that speaks as a test has it."""

    def __init__(self) -> None:
        self.counters = self
        self.bytes_in = 0
        self.loss = ""

    def give_up(self, loss: str) -> None:
        self.loss = loss

    def __str__(self) -> str:
        return "splat server 1"


def test_a_server_at_work_is_given_more_time_and_one_that_answers_as_long_as_it_does() -> None:
    answering, at_work, silent = Line(), Line(), Line()
    lines = {1: answering, 2: at_work, 3: silent}

    def ask(server: int) -> None:
        if server == 1:
            answering.bytes_in += 1

    watch = SilenceWatch(0.2, at_work=lambda server: server == 2, ask=ask)
    try:
        for server, line in lines.items():
            watch.begin(server, line)  # type: ignore[arg-type]
        began = time.monotonic()
        wait_until(lambda: bool(silent.loss), "is silence noticed")
        assert time.monotonic() - began >= 0.2
        assert silent.loss == "splat server 1 has said nothing for 0.2 s: it is frozen, overloaded or cut off"
        wait_until(lambda: bool(at_work.loss), "is it noticed of one at work")
        assert time.monotonic() - began >= 15 * 0.2 and not answering.loss
    finally:
        watch.close()


def test_whoever_was_held_up_itself_blames_nobody() -> None:
    line, asked, held_up = Line(), threading.Event(), threading.Event()

    def ask(server: int) -> None:
        if not asked.is_set():
            asked.set()
            time.sleep(3 * 0.2)  # as if the whole process had been stopped
            held_up.set()
        line.bytes_in += 1

    watch = SilenceWatch(0.2, at_work=lambda server: False, ask=ask)
    try:
        watch.begin(1, line)  # type: ignore[arg-type]
        assert held_up.wait(PATIENCE)
        time.sleep(0.4)
        assert not line.loss
    finally:
        watch.close()
