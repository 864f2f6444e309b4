"""A map/shade server is lost before the volume is surveyed: the others, or one in its place, begin anew."""

import os
import re
import signal
from pathlib import Path

import msgspec
import psutil
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.messages.coordinated import (
    ASKED,
    DESCRIPTION,
    FIRST,
    JOINED,
    SECOND,
    CheckedCoordinator,
    counted,
    joins,
    read_by,
    said,
    sent,
)
from support.messages.message_samples import IDENTITY
from support.programs.server_processes import is_server
from volsplat.client import Session
from volsplat.client.coordinator.events.events import ServerLost
from volsplat.client.coordinator.events.instructions import PublishVolume
from volsplat.client.coordinator.holding.phase import Phase
from volsplat.client.coordinator.server_states import missing_boxes
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.messages import messages

__all__ = ["head", "scene", "single"]

MOMENTS = ["reading the volume's header", "reading the volume( as . sub-cubes)?", "counting the histograms"]
DESCRIBED = said(FIRST, messages.VolumeDescribed(DESCRIPTION, None, IDENTITY))


class Killer:
    """Kills a map/shade server of this process once, at a moment of its progress."""

    def __init__(self, moment: str) -> None:
        self.moment = moment
        self.killed = 0
        self.lines: list[str] = []

    def __call__(self, line: str) -> None:
        self.lines.append(line)
        if re.fullmatch(self.moment, line) and not self.killed:
            servers = [one for one in psutil.Process().children(recursive=True) if is_server(one, "mapshade_server")]
            self.killed = servers[-1].pid
            os.kill(self.killed, signal.SIGKILL)


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("moment", MOMENTS)
def test_the_session_opens_and_draws_all(
    head: Path, single: SingleProcess, scene: Scene, moment: str, workers: int
) -> None:
    killer = Killer(moment)
    with Session(head, workers=workers, on_progress=killer) as session:
        assert session.volume.survey == single.volume.survey and killer.killed
        assert torch.equal(session.render(scene), single.render(scene))
        heirs = "another one is started in its place and takes over" if workers == 1 else "others take over"
        assert any(f"process {killer.killed}" in line and heirs in line for line in killer.lines)
        assert missing_boxes(session.servers) == ()


def gathered() -> CheckedCoordinator:
    coordinator = CheckedCoordinator()
    for event in [*joins(*JOINED), ASKED]:
        coordinator.handle(event)
    return coordinator


def test_another_one_describes_the_volume_if_the_one_that_was_asked_is_lost() -> None:
    coordinator = gathered()
    assert (SECOND, messages.DescribeVolume) in sent(coordinator.handle(ServerLost(FIRST, "it is gone")))
    told = coordinator.handle(said(SECOND, DESCRIBED.message))
    assert (SECOND, messages.ReadSubCubes) in sent(told) and coordinator.holding.boxes.keys() == {SECOND}


def test_what_was_counted_before_the_loss_counts_no_more() -> None:
    coordinator = gathered()
    coordinator.handle(DESCRIBED)
    late = read_by(coordinator, FIRST)
    coordinator.handle(read_by(coordinator, SECOND))
    coordinator.handle(ServerLost(SECOND, "it is gone"))
    assert coordinator.handle(late) == [] and coordinator.holding.phase is Phase.READING
    coordinator.handle(read_by(coordinator, FIRST))
    counts = counted(FIRST, 720)
    message = msgspec.structs.replace(counts.message, assignment=2)
    (published,) = coordinator.handle(said(FIRST, message, bytes(counts.payload)))
    assert isinstance(published, PublishVolume) and published.volume.survey.voxels == 720
