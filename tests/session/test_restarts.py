"""Servers that the client started itself: in the place of one that ends another is started, but not for ever."""

import logging
import math
import re
import signal
from pathlib import Path

import psutil
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.patience import PATIENCE, wait_until
from support.programs.server_processes import servers
from volsplat.client import Session
from volsplat.client.session.links import server_links
from volsplat.client.session.single import SingleProcess
from volsplat.deploy import restart_limit
from volsplat.deploy.restart_limit import MOST_RESTARTS
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import PeerLost, VolsplatError

__all__ = ["head", "scene", "single"]


NAMES = {"mapshade_server": "map/shade server", "splat_server": "splat server"}


def kill_one(session: Session, program: str) -> None:
    """Once there is one."""
    wait_until(lambda: servers(session, program), "is there one")
    servers(session, program)[0].send_signal(signal.SIGKILL)


@pytest.mark.parametrize("program", ["mapshade_server", "splat_server"])
@pytest.mark.parametrize("workers", [1, 2])
def test_after_a_kill_as_many_servers_draw_as_before(
    head: Path, single: SingleProcess, scene: Scene, program: str, workers: int
) -> None:
    with Session(head, workers=workers) as session:
        session.render(scene)
        for losses in (1, 2):
            kill_one(session, program)
            wait_until(lambda n=losses: sum(server.lost for server in session.servers) == n, "is it lost")  # type: ignore[misc]
            assert torch.equal(session.render(scene), single.render(scene))
            wait_until(lambda: len(session.server_processes) == workers + 1, "is another one started")

        def all_draw() -> bool:
            return (
                torch.equal(session.render(scene), single.render(scene))
                and sum(bool(server.boxes) for server in session.servers if not server.lost) == workers
            )

        wait_until(all_draw, "does each get a part")


@pytest.mark.parametrize("program", ["mapshade_server", "splat_server"])
def test_a_server_that_ends_again_and_again_is_given_up_with_one_clear_line(
    head: Path, scene: Scene, program: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(restart_limit, "RESTARTS_SECONDS", math.inf)  # a busy machine may need a minute for so many
    with Session(head, workers=1) as session:
        session.render(scene)
        with pytest.raises(PeerLost) as lost:
            for losses in range(1, MOST_RESTARTS + 2):
                kill_one(session, program)
                wait_until(lambda n=losses: sum(server.lost for server in session.servers) == n, "is it lost")  # type: ignore[misc]
                session.render(scene)
        left = [psutil.Process(pid) for pid in session.server_processes if psutil.pid_exists(pid)]
        told = str(lost.value)
        assert NAMES[program] in told and "\n" not in told
        assert "was killed by SIGKILL (by hand, or by the system for want of memory)" in told
    assert psutil.wait_procs(left, timeout=PATIENCE)[1] == []


@pytest.mark.parametrize("told_of", ["server_joined", ""], ids=["a server that joins", "anything"])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # that cannot be logged either
def test_a_session_ends_in_a_line_if_an_error_keeps_it_from_hearing_its_servers(head: Path, told_of: str) -> None:
    """Here of what logs, as by a clock that Python has no date for."""

    def fails(record: logging.LogRecord) -> bool:
        if told_of in ("", getattr(record, "event", None)):
            raise OverflowError("date value\nout of range")  # a script's own may have several lines
        return True

    logger = logging.getLogger(server_links.__name__)
    level = logger.level
    logger.setLevel(logging.INFO)
    logger.addFilter(fails)
    try:
        with Session(head, workers=1) as session:
            began = [psutil.Process(pid) for pid in session.server_processes]
            with pytest.raises(VolsplatError) as failed:
                session.default_scene()
        assert psutil.wait_procs(began, timeout=PATIENCE)[1] == [] and not session.server_processes
    finally:
        logger.removeFilter(fails)
        logger.setLevel(level)
    told = r"the session cannot go on: \S+ server \d+ .*is heard no more: OverflowError: date value out of range"
    assert re.fullmatch(told, str(failed.value))
