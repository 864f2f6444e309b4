"""Which step to draw while things move: the finest that holds the wanted rate, from measured times."""

from __future__ import annotations

from volsplat.protocol.description.scene import Step
from volsplat.protocol.rules.refinement import PAPER_STEPS

IMAGES_PER_SECOND = 30.0
_NEWEST_WEIGHT = 0.4  # of the newest time in the running mean
_NEWS = 1.6  # a change of one step's time by this factor tells of the others as well
_MARGIN = 0.8  # of the time between two images that a finer step may take; what is drawn already may take all of it


class StepPacing:
    """Running times of the steps, in seconds, and the choice that follows from them."""

    def __init__(self, images_per_second: float = IMAGES_PER_SECOND) -> None:
        self._interval = 1 / images_per_second
        self._seconds: dict[Step, float] = {}
        self._drawn: Step | None = None  # the step that was measured last,
        self._began_at = 0.0  # and its time when the others were last in proportion to it
        self._moving = Step.A

    def measured(self, step: Step, seconds: float) -> None:
        """Note the time of one image.

        What makes one step much slower or faster (zoom, image size, tables) does so with all, so that those not drawn
        lately follow in proportion. What varies from image to image is no news of the others.
        """
        old = self._seconds.get(step)
        new = seconds if old is None else old + _NEWEST_WEIGHT * (seconds - old)
        self._seconds[step] = new
        if step != self._drawn:
            self._drawn, self._began_at = step, new
        change = new / self._began_at
        if not 1 / _NEWS <= change <= _NEWS:
            for other in self._seconds.keys() - {step}:
                self._seconds[other] *= change
            self._began_at = new
        self._moving = max((step for step in PAPER_STEPS if self._holds(step)), default=Step.A)

    def expected(self, step: Step) -> float | None:
        """Seconds that the step will take, if that is known."""
        return self._seconds.get(step)

    def step_while_moving(self) -> Step:
        """The finest step that holds the rate; A if none is known to.

        A step is kept until it takes too long, and left for a finer one only if that will surely do: times vary,
        and an image that changes its looks with them flickers.
        """
        return self._moving

    def _holds(self, step: Step) -> bool:
        if step not in self._seconds:
            return False
        share = 1.0 if step <= self._moving else _MARGIN
        return self._seconds[step] <= share * self._interval
