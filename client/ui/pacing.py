"""Which step to draw while things move: the finest that holds the wanted rate, from measured times."""

from __future__ import annotations

from volsplat.protocol.scene import Step

IMAGES_PER_SECOND = 30.0
_NEWEST_WEIGHT = 0.4  # of the newest time in the running mean
_MARGIN = 0.8  # of the time between two images, the rest for encoding and for what varies


class StepPacing:
    """Running times of the steps, in seconds, and the choice that follows from them."""

    def __init__(self, images_per_second: float = IMAGES_PER_SECOND) -> None:
        self._budget = _MARGIN / images_per_second
        self._seconds: dict[Step, float] = {}

    def measured(self, step: Step, seconds: float) -> None:
        """Note the time of one image.

        What makes one step slower or faster (zoom, image size, tables) does so with all, so that those not drawn
        lately follow in proportion.
        """
        old = self._seconds.get(step)
        new = seconds if old is None else old + _NEWEST_WEIGHT * (seconds - old)
        if old:
            self._seconds = {other: time * new / old for other, time in self._seconds.items()}
        self._seconds[step] = new

    def expected(self, step: Step) -> float | None:
        """Seconds that the step will take, where that is known."""
        return self._seconds.get(step)

    def step_while_moving(self) -> Step:
        """The finest step that holds the rate; A where none is known to."""
        holding = [step for step, seconds in self._seconds.items() if seconds <= self._budget]
        return max(holding, default=Step.A)
