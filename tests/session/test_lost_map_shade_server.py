"""A map/shade server is killed while others hold sub-cubes: what a screen sees, and what a script is told."""

import shutil
import signal
import sys
import threading
from itertools import groupby
from pathlib import Path

import msgspec
import numpy as np
import psutil
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.messages.message_samples import UNFORESEEN
from support.patience import PATIENCE, wait_until
from support.programs.server_processes import is_server
from volsplat.client import Session
from volsplat.client.coordinator.server_states import ServerState
from volsplat.client.session.renderer import Refinement, finished_whole
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Image, Scene
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import PeerLost

__all__ = ["head", "scene", "single"]

WHOLE_CELLS = [Step.C, Step.D, Step.E, Step.F]  # with strides, bounds would clip the outermost samples' blocks


class Watched:
    """A session's lines of progress: kills a map/shade server at one of them, and knows when its loss was told."""

    def __init__(self, kill_at: str = "") -> None:
        self.kill_at = kill_at
        self.session: Session | None = None
        self.killed: list[int] = []
        self.loss = ""
        self.told = threading.Event()

    def __call__(self, line: str) -> None:
        if line == self.kill_at:
            self.kill_at = ""
            self.kill()
        if "others take over" in line:
            self.loss = line
            self.told.set()

    def kill(self) -> None:
        assert self.session is not None
        living = [psutil.Process(pid) for pid in self.session.server_processes if pid not in self.killed]
        server = next(one for one in living if is_server(one, "mapshade_server"))
        self.killed.append(server.pid)
        server.send_signal(signal.SIGKILL)

    def lost(self) -> ServerState:
        assert self.session is not None
        (lost,) = [server for server in self.session.servers if server.lost]
        return lost

    def boxes_left(self) -> tuple[Box, ...]:
        assert self.session is not None
        return tuple(box for server in self.session.servers if not server.lost for box in server.boxes)


def opened(head: Path, watched: Watched, workers: int = 2) -> Session:
    watched.session = Session(head, workers=workers, on_progress=watched)
    return watched.session


def drawn_steps(session: Session, scene: Scene) -> list[Refinement]:
    return [refinement for refinement in session.refine(scene) if refinement.complete]


def missing(refinement: Refinement) -> tuple[Box, ...]:
    assert refinement.outcome is not None
    return refinement.outcome.servers.missing


def test_every_server_is_listed_with_what_it_holds(head: Path) -> None:
    with Session(head, workers=3) as session:
        dims = session.volume.description.geometry.dims
        splat = [server for server in session.servers if server.role == Role.SPLAT_SERVER]
        workers = [server for server in session.servers if server.role == Role.MAPSHADE_SERVER]
        assert (len(splat), len(workers)) == (1, 3)
        assert sum(worker.voxels for worker in workers) == Box((0, 0, 0), dims).voxels
        assert {server.host for server in session.servers} == {"127.0.0.1"}
        assert not any(server.lost for server in session.servers)


def check_whole(session: Session, single: SingleProcess, scene: Scene) -> None:
    """The session draws what it would have drawn without a loss, and somebody holds each voxel."""
    assert torch.equal(session.render(scene), single.render(scene))
    dims = session.volume.description.geometry.dims
    assert sum(server.voxels for server in session.servers if not server.lost) == Box((0, 0, 0), dims).voxels


@pytest.mark.parametrize("workers", [2, 3])
def test_between_frames_the_others_take_over(head: Path, single: SingleProcess, scene: Scene, workers: int) -> None:
    watched = Watched()
    with opened(head, watched, workers) as session:
        assert torch.equal(session.render(scene), single.render(scene))
        watched.kill()
        assert watched.told.wait(PATIENCE)
        check_whole(session, single, scene)
        lost = watched.lost()
        place = "on this machine" if sys.platform == "linux" else "127.0.0.1"  # see unix_socket
        assert lost.name in watched.loss and place in watched.loss and "others take over i 0-" in watched.loss
        assert lost.handed_over and "\n" not in watched.loss
        for refinement in finished_whole(session.refine(scene)):
            assert torch.equal(refinement.image, single.render(scene, refinement.step))


def test_an_error_that_nobody_has_foreseen_in_sending_to_one_loses_it_alone(
    head: Path, single: SingleProcess, scene: Scene, caplog: pytest.LogCaptureFixture
) -> None:
    watched = Watched()
    with opened(head, watched) as session:
        assert torch.equal(session.render(scene), single.render(scene))
        server = next(server for server in session.servers if server.role is Role.MAPSHADE_SERVER)
        session._links.send(server.id, UNFORESEEN, memoryview(b"by the sending thread"))
        assert watched.told.wait(PATIENCE)
        assert "is sent nothing more: AttributeError: " in watched.loss and "\n" not in watched.loss
        check_whole(session, single, scene)
        assert watched.lost().id == server.id
    (logged,) = [record for record in caplog.records if record.exc_info]
    assert logged.getMessage().endswith("is sent nothing more") and "in payload_bytes" in caplog.text


@pytest.mark.parametrize("moment", ["step A", "step D"])
def test_within_a_refinement_a_screen_sees_what_is_left_and_then_the_step_whole(
    head: Path, single: SingleProcess, scene: Scene, moment: str
) -> None:
    watched = Watched(kill_at=moment)
    with opened(head, watched, workers=3) as session:
        steps = drawn_steps(session, scene)
        whole = [refinement for refinement in steps if not missing(refinement)]
        assert [refinement.step for refinement in whole] == list(PAPER_STEPS)
        for refinement in whole:
            assert torch.equal(refinement.image, single.render(scene, refinement.step))
        (left,) = [refinement for refinement in steps if missing(refinement)]
        assert f"step {left.step}" == moment and missing(left) == watched.lost().boxes
        assert left.outcome is not None and left.outcome.servers.healing
        assert not torch.equal(left.image, single.render(scene, left.step))


@pytest.mark.parametrize("moment", ["making voxel packets", "step F"])
def test_a_script_s_frame_is_drawn_anew_and_whole(head: Path, single: SingleProcess, scene: Scene, moment: str) -> None:
    watched = Watched(kill_at=moment)
    with opened(head, watched) as session:
        check_whole(session, single, scene)
        assert watched.lost().handed_over


def test_after_a_loss_while_the_volume_is_read_again_the_others_read_all(
    head: Path, single: SingleProcess, scene: Scene
) -> None:
    watched = Watched()
    with opened(head, watched) as session:
        session.render(scene)
        watched.kill_at = "reading the volume as 2 sub-cubes"
        other = msgspec.structs.replace(scene, quantise=msgspec.structs.replace(scene.quantise, directions="paper"))
        check_whole(session, single, other)


@pytest.mark.parametrize("moment", ["having others read what was lost", "step F"])
def test_two_losses_and_the_third_server_draws_all(
    head: Path, single: SingleProcess, scene: Scene, moment: str
) -> None:
    watched = Watched()
    with opened(head, watched, workers=3) as session:
        check_whole(session, single, scene)
        watched.kill_at = moment
        watched.kill()
        check_whole(session, single, scene)
        assert sum(server.lost for server in session.servers) == 2


def test_servers_for_whom_no_voxel_is_left_hold_nothing_and_take_over(tmp_path: Path) -> None:
    few, watched = tmp_path / "few.npy", Watched()
    np.save(few, np.array([[[40, 200]]], "u1"))
    with SingleProcess(few) as single, opened(few, watched, workers=3) as session:
        scene = msgspec.structs.replace(session.default_scene(), image=Image(width=16, height=16))
        check_whole(session, single, scene)
        assert sorted(server.voxels for server in session.servers) == [0, 0, 1, 1]
        watched.kill()
        watched.kill()
        check_whole(session, single, scene)


def test_what_nobody_else_can_read_is_missing_and_a_script_is_told(
    tmp_path: Path, head: Path, single: SingleProcess, scene: Scene
) -> None:
    copy = tmp_path / head.name
    shutil.copy(head, copy)
    view = msgspec.structs.replace(scene.view, zoom=1.25, center=(15.5, 19.5, 17.5))  # bounds would fit otherwise
    scene = msgspec.structs.replace(scene, view=view)
    watched = Watched()
    with opened(copy, watched) as session:
        session.render(scene)
        copy.unlink()
        watched.kill()
        assert watched.told.wait(PATIENCE)
        wait_until(lambda: not watched.lost().handed_over, "do others fail to read it")
        lost, (left,) = watched.lost(), watched.boxes_left()
        steps = drawn_steps(session, scene)
        # A frame is drawn again where one that was started anew joins meanwhile, which cannot read it either.
        assert [step for step, _ in groupby(refinement.step for refinement in steps)] == list(PAPER_STEPS)
        assert all(missing(refinement) == lost.boxes for refinement in steps)
        only_left = msgspec.structs.replace(scene, bounds=Bounds(low=left.low, high=left.high))
        for refinement in steps:
            if refinement.step in WHOLE_CELLS:
                assert torch.equal(refinement.image, single.render(only_left, refinement.step))
        for asks in (session.render, session.finish):
            with pytest.raises(PeerLost, match="of the volume are missing") as told:
                asks(scene)
            assert "\n" not in str(told.value)
        with pytest.raises(PeerLost, match="missing"):
            list(finished_whole(session.refine(scene)))
