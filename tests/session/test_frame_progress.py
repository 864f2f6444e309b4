"""How far a frame is, for who waits: splat servers say it once a second, and the one that is behind is told of."""

from __future__ import annotations

import re

import numpy as np
import pytest

from support.messages.coordinated import SPLAT, CheckedCoordinator, said
from support.messages.drawn import LEFT, LOST, drawing_big, finished, image, running
from volsplat.client.coordinator.coordinator_events import AbortAsked, CutOff, Instruction, ReportProgress
from volsplat.client.memory.array_volume import Volume
from volsplat.client.session import single
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Step
from volsplat.protocol.messages import messages


def tell(coordinator: CheckedCoordinator, server: int, share: float, frame: int = 1) -> list[Instruction]:
    return coordinator.handle(said(server, messages.FrameProgress(frame, share)))


def test_the_splat_server_that_is_behind_says_how_far_a_frame_is() -> None:
    coordinator = drawing_big()
    assert tell(coordinator, SPLAT, 0.75) == tell(coordinator, LOST, 0.25) == [ReportProgress("step F: 0 %")]
    assert tell(coordinator, LEFT, 0.5) == [ReportProgress("step F: 25 %")]
    request = running(coordinator)
    for event in (finished(request, LOST), image(request, LOST, complete=True)):
        coordinator.handle(event)
    assert tell(coordinator, LEFT, 0.6) == [ReportProgress("step F: 60 %")], "who is done is not waited for"


def test_nothing_is_told_of_a_frame_that_nobody_waits_for() -> None:
    coordinator = drawing_big()
    assert tell(coordinator, SPLAT, 0.5, frame=2) == []
    coordinator.handle(AbortAsked(1))
    assert tell(coordinator, SPLAT, 0.5) == []


def test_who_has_no_part_in_the_frame_cannot_say_how_far_it_is() -> None:
    coordinator = drawing_big()
    frame = coordinator.frames.frame
    assert frame is not None
    del frame.rectangles[LOST]
    told = tell(coordinator, LOST, 0.5)
    assert [type(one) for one in told if isinstance(one, CutOff)] == [CutOff]


@pytest.mark.parametrize("step", [Step.F, Step.G])
def test_a_single_process_tells_it_as_well(step: Step, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(single, "PROGRESS_SECONDS", 0.0)
    volume = Volume(np.arange(4096, dtype=np.uint16).reshape(16, 16, 16), spacing=(1, 1, 1))
    told: list[str] = []
    with SingleProcess(volume, threads=1, on_progress=told.append) as renderer:
        renderer.finish(renderer.volume.default_scene().with_(size=200), step)
    shares = [int(found[1]) for line in told if (found := re.fullmatch(rf"step {step}: (\d+) %", line))]
    assert shares and shares == sorted(shares) and shares[-1] <= 100
