"""Images that are drawn while nobody looks for new ones: for files, by the session whose pictures the page shows."""

from __future__ import annotations

from volsplat.client.session.renderer import Refinement
from volsplat.client.session.session import Session
from volsplat.client.session.turns import Urgency
from volsplat.client.ui.viewing.drawing_loop import DrawingLoop
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene


class IdleDrawing:
    """Draws finished images whenever the drawing loop has nothing to do, and makes way for it at once."""

    def __init__(self, session: Session, loop: DrawingLoop) -> None:
        self._session = session
        self._loop = loop

    @property
    def volume(self) -> SurveyedVolume:
        """What is known of the volume."""
        return self._session.volume

    def finish(self, scene: Scene, step: Step = Step.F) -> Refinement:
        """The finished image of one step. Raises FrameGivenUp if it made way, else as `Session.finish` does."""
        self._loop.wait_until_drawn()
        turn = self._session.turn()
        with turn.taken(Urgency.AT_REST):
            return turn.finish(scene, step)
