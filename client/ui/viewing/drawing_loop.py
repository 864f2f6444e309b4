"""Draws the newest scene, again and again, on a thread of its own.

While a person is at it (the scene is not settled) each picture is the best that holds the rate. Once it is
settled, the image refines from there to the scene's finest step; step G waits until the hand has rested. A newer scene
takes the place of whatever is being refined. Others may draw with the session: who takes it away has the scene drawn
again once it is free.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from volsplat.client.session.asked_frames import FrameGivenUp
from volsplat.client.session.asked_images import DrawingTurn
from volsplat.client.session.renderer import PARTIAL_INTERVAL, Refinement, laid_over
from volsplat.client.session.session import Session
from volsplat.client.session.turns import Urgency
from volsplat.client.ui.viewing.pacing import Pacing, Rung
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneModel, SceneState
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.rules.refinement import (
    PAPER_STEPS,
    distinct_steps,
    drawn_alike,
    finer,
    finest_paper_step,
    finest_step,
    stands_for,
)
from volsplat.protocol.text.errors import VolsplatError

log = logging.getLogger(__name__)

LONGEST_ABORT_SECONDS = 0.5  # that the end is held up by a frame that is aborted
REST_SECONDS = 0.3  # after the last change, before step G
NO_PARTIAL_IMAGES = threading.TIMEOUT_MAX  # seconds between them


class DrawingLoop:
    """Watches `model` and hands pictures to `show` and troubles, in words, to `tell`, both on its own thread.

    `tell` may not wait for what others do with the loop.
    """

    def __init__(
        self,
        session: Session,
        model: SceneModel,
        show: Callable[[Picture], None],
        tell: Callable[[VolsplatError], None],
        is_watched: Callable[[], bool] = lambda: True,
    ) -> None:
        """Pictures that nobody watches are not encoded."""
        self.pacing = Pacing()
        self.session = session
        self._model = model
        self._show = show
        self._tell = tell
        self._is_watched = is_watched
        self._on_first: Callable[[Picture], None] | None = None
        self._shown: Picture | None = None  # the newest such
        self._number = 0
        self._drawn_revision = 0
        self._drawing = False
        self._refining: DrawingTurn | None = None
        self._lost_revision = 0  # that was being drawn when others took the session
        self._lost_at: float | None = None  # the drawing thread's: when they first did since a picture was finished
        self._failure: VolsplatError | None = None
        self._closed = False
        self._changed = threading.Condition()  # guards what may change, and tells of a newer scene
        self._unsubscribe = model.subscribe(self._on_change)
        self._thread = threading.Thread(target=self._run, name="draw", daemon=True)

    def start(self) -> None:
        """Safe to call twice."""
        if self._thread.ident is None:
            self._thread.start()

    def tell_first(self, tell: Callable[[Picture], None]) -> None:
        """Have the first picture whose step is finished told, by the drawing thread. Before it starts."""
        self._on_first = tell

    def close(self) -> None:
        """End what is drawn and the thread; a frame whose server answers no more ends with the session."""
        self._unsubscribe()
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            self._abort_refinement()
        if self._thread.is_alive():
            self._thread.join(LONGEST_ABORT_SECONDS)

    @property
    def drawing(self) -> bool:
        """Whether a picture is on its way."""
        return self._drawing

    @property
    def failure(self) -> VolsplatError | None:
        """Why the scene will have no finished picture, unless it is drawn again."""
        return None if self._something_to_do() else self._failure

    @property
    def shown(self) -> Picture | None:
        """The newest whose step is finished."""
        return self._shown

    def wait_until_drawn(self) -> None:
        """Until the scene is settled and drawn to the end, or known not to be drawn."""
        with self._changed:
            self._changed.wait_for(self._nothing_to_do)

    def draw_with(self, session: Session) -> None:
        """Draw the scene anew, by another session of the same volume."""
        with self._changed:
            self.session = session
            self.draw_again()

    def draw_again(self) -> None:
        """Draw the scene anew although it is the same, since what holds the volume has changed."""
        with self._changed:
            self._drawn_revision = self._lost_revision = 0
            self._shown = None
            self._changed.notify_all()
            self._abort_refinement()

    def _on_change(self, state: SceneState) -> None:
        with self._changed:
            self._changed.notify_all()
            self._abort_refinement()

    def _abort_refinement(self) -> None:
        # A picture of a moving scene is finished, however many changes come meanwhile: else none would ever be.
        if self._refining is not None:
            self._refining.end()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(self._something_to_do)
                if self._closed:
                    return
                state = self._model.now
                urgency = Urgency.OWED if state.revision == self._lost_revision else Urgency.CHANGED
                if urgency is Urgency.CHANGED:
                    self._lost_at = None
                self._drawn_revision = state.revision
                self._drawing = True
                self._failure = None
                session = self.session
                turn = session.turn()
                self._refining = turn if state.settled else None
            trouble = self._drawn(state, turn, urgency)
            with self._changed:
                self._drawing, self._refining = False, None
                if isinstance(trouble, FrameGivenUp):
                    self._note_lost(state, turn)
                    trouble = None
                if session is not self.session:  # which draws the scene now
                    trouble = None
                self._failure = trouble
                self._changed.notify_all()
                if trouble is not None:
                    self._tell(trouble)

    def _note_lost(self, state: SceneState, turn: DrawingTurn) -> None:
        """The scene is to be drawn again if others took the session, and not a newer scene the place of this one."""
        if not turn.over:
            self._lost_revision = state.revision
            self._drawn_revision = 0
            self._lost_at = self._lost_at or time.monotonic()

    def _drawn(self, state: SceneState, turn: DrawingTurn, urgency: Urgency) -> VolsplatError | None:
        """Draw this scene; returns why that cannot be, or that others took the session."""
        try:
            if state.settled:
                self._refine(state, turn, urgency)
            else:
                self._draw_moving(state, turn)
        except VolsplatError as error:
            return error
        except Exception as error:  # an error in our own code: the person must hear of it, and the page must live on
            log.exception("this scene could not be drawn")
            return VolsplatError(f"this scene could not be drawn: {type(error).__name__}: {error}")
        return None

    def _something_to_do(self) -> bool:
        return self._closed or self._model.now.revision != self._drawn_revision

    def _nothing_to_do(self) -> bool:
        """A moving scene will change again."""
        now = self._model.now
        return self._closed or (not self._drawing and now.settled and now.revision == self._drawn_revision)

    def _draw_moving(self, state: SceneState, turn: DrawingTurn) -> None:
        """One picture, perhaps smaller than the scene's: the page shows it as large; none if the last one stands."""
        if self._still_last(state):
            return
        rung = self.pacing.while_moving(state.scene)
        scene, step = rung.drawn(state.scene), rung.step
        with turn.taken(Urgency.MOVING):
            for refinement in turn.draw(scene, step, NO_PARTIAL_IMAGES, exact=False, thinning=rung.left_out):
                self._publish(state, refinement, rung)

    def _still_last(self, state: SceneState) -> bool:
        """Whether what is shown is the last picture of this scene, too. Events of pointers are told with a new one."""
        shown = self._shown
        return (
            shown is not None
            and shown.last
            and shown.state.events == state.events
            and drawn_alike(shown.state.scene, state.scene)
        )

    def _refine(self, state: SceneState, turn: DrawingTurn, urgency: Urgency) -> None:
        shown, finest, first = self._shown, finest_step(state.scene), self._first_to_draw(state.scene)
        if first is None:
            assert shown is not None
            self._publish(state, Refinement(finest, shown.published, shown.outcome))
            return
        rests_at = time.monotonic() + REST_SECONDS
        if first in PAPER_STEPS:
            with turn.taken(urgency, self._lost_at):
                self._refine_from(first, finest_paper_step(state.scene), state, turn)
        if finest not in PAPER_STEPS and self._rests_until(rests_at):
            with turn.taken(Urgency.AT_REST if first in PAPER_STEPS else urgency, self._lost_at):
                self._refine_from(finest, finest, state, turn)

    def _first_to_draw(self, scene: Scene) -> Step | None:
        """None if what is shown is the scene's last picture."""
        shown, finest = self._shown, finest_step(scene)
        if shown is None or not drawn_alike(shown.state.scene, scene):
            return Step.A
        step = stands_for(scene, shown.step)
        if step > finest or (step == finest and not shown.published.exact):  # was asked for before, or only looked at
            return finest
        return finer(step, finest) if shown.whole else step

    def _rests_until(self, moment: float) -> bool:
        """Whether nothing has changed by then."""
        with self._changed:
            return not self._changed.wait_for(self._something_to_do, max(moment - time.monotonic(), 0.0))

    def _refine_from(self, first: Step, last: Step, state: SceneState, turn: DrawingTurn) -> None:
        """Draw these steps; of those with the same picture only the last."""
        for step in distinct_steps(state.scene):
            if first <= step <= last and not self._draw_step(step, state, turn):
                return

    def _draw_step(self, step: Step, state: SceneState, turn: DrawingTurn) -> bool:
        """Returns whether it is finished, and still the scene's. Raises FrameGivenUp if the turn was lost."""
        finished = False
        shown, exact = self._shown, step == finest_step(state.scene)
        for refinement in turn.draw(state.scene, step, PARTIAL_INTERVAL, exact):
            if self._model.now.revision != state.revision:
                return False
            # What a drag or coarser steps have left on the screen stays there until the step after it is finished.
            if step != Step.A and not refinement.complete and not state.scene.refine.bare_buffer:
                assert shown is not None
                refinement = replace(
                    refinement, published=laid_over(refinement.published, shown.published_in_full_size)
                )
            self._publish(state, refinement, Rung(refinement.step))
            finished = refinement.complete
        return finished

    def _publish(self, state: SceneState, refinement: Refinement, drawn: Rung | None = None) -> None:
        """Show an image; what was `drawn` for it is measured."""
        self._number += 1
        picture = Picture(
            self._number,
            state,
            refinement.step,
            refinement.published,
            refinement.outcome,
            refinement.undrawn,
            1 if drawn is None else drawn.thinning.one_in,
        )
        began = time.perf_counter()
        if self._is_watched():
            _ = picture.data  # encoded here, so that the page's thread need not
        encoding_seconds = 0.0 if picture.last else time.perf_counter() - began  # what moves is never sent as PNG
        if refinement.outcome is not None and drawn is not None:
            seconds = refinement.outcome.wall_seconds + encoding_seconds
            if state.settled:
                self.pacing.measured_at_rest(drawn.step, seconds)
            else:
                self.pacing.measured(drawn, seconds)
        if refinement.complete:
            self._shown = picture
            self._lost_at = None
            self._tell_first(picture)
        self._show(picture)

    def _tell_first(self, picture: Picture) -> None:
        tell, self._on_first = self._on_first, None
        if tell is not None:
            tell(picture)
