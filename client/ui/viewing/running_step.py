"""Which step is being drawn, and which are finished, as far as pictures tell."""

from __future__ import annotations

from dataclasses import dataclass

from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.rules.refinement import distinct_steps, drawn_alike, finest_step, stands_for


@dataclass(frozen=True)
class Progress:
    """`running` is None if all is done that the scene asks for; `finished` is the finest step that is."""

    running: Step | None
    finished: Step | None


def progress(picture: Picture | None, state: SceneState, while_moving: Step) -> Progress:
    """How far the refinement of `state` is, by the newest picture. `while_moving` is drawn of a scene not settled."""
    if picture is None or not drawn_alike(picture.state.scene, state.scene):
        return Progress(running=Step.A if state.settled else while_moving, finished=None)
    steps, finest = distinct_steps(state.scene), finest_step(state.scene)
    drawn = stands_for(state.scene, picture.step)
    if state.settled and drawn > finest:  # was asked for before
        return Progress(running=finest, finished=None)
    if not picture.complete or (state.settled and not picture.whole):
        return Progress(running=drawn, finished=max((step for step in steps if step < drawn), default=None))
    if not state.settled:
        return Progress(running=None, finished=picture.step)
    return Progress(running=min((step for step in steps if step > drawn), default=None), finished=drawn)
