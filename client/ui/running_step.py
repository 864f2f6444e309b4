"""Which step is being drawn, and which are finished, as far as pictures tell."""

from __future__ import annotations

from dataclasses import dataclass

from volsplat.client.ui.picture import Picture
from volsplat.client.ui.scene_model import SceneState
from volsplat.protocol.scene import Step


@dataclass(frozen=True)
class Progress:
    """`running` is None where all is done that the scene asks for; `finished` is the finest step that is."""

    running: Step | None
    finished: Step | None


def progress(picture: Picture | None, state: SceneState, while_moving: Step) -> Progress:
    """How far the refinement of `state` is, by the newest picture. `while_moving` is drawn of a scene not settled."""
    if picture is None or picture.state.scene != state.scene:
        return Progress(running=Step.A if state.settled else while_moving, finished=None)
    before = _neighbour(picture.step, -1)
    if not picture.complete:
        return Progress(running=picture.step, finished=before)
    if not state.settled:
        return Progress(running=None, finished=picture.step)
    return Progress(running=_neighbour(picture.step, 1), finished=picture.step)


def _neighbour(step: Step, by: int) -> Step | None:
    steps = list(Step)
    n = steps.index(step) + by
    return steps[n] if 0 <= n < len(steps) else None
