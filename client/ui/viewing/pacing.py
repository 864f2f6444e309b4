"""What to draw while things move: the best picture that holds the wanted rate, from measured times.

Best is the finest of the paper's steps, lit and with footprints, in as large an image as can be: in half the width and
height it is more like the finished picture than a coarser step of the whole size. So it is, where that takes too long,
with every 2nd or 4th voxel on each axis in the smallest image (docs/notes/performance_log.md).
"""

from __future__ import annotations

from typing import NamedTuple

from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.rules.refinement import PAPER_STEPS

IMAGES_PER_SECOND = 30.0
SMALLER = (0.25, 0.375, 0.5, 0.75)  # images, as shares of the width and of the height
LEAST_SIDE = 160  # pixels of a smaller image
_NEWEST_WEIGHT = 0.4  # of the newest time in the running mean
_NEWS = 1.6  # a change of one time by this factor tells of the others as well
_MARGIN = 0.8  # of the time between two images that a better one may take; what is drawn already may take all of it
_LIT_PATIENCE = 1.6  # intervals that the smallest image of the finest step may take before fewer voxels are drawn
_SLACK = 1.5  # by which a smaller image may be thought slower than the whole one's time tells
_VOXELS_SHARE = 0.5  # of a step's time, which a smaller image does not save, and fewer voxels save by half an octave
_MOST_OCTAVES = 2


class Rung(NamedTuple):
    """One way to draw: a step, in an image whose width and height are this share of the scene's.

    Of the voxels that it draws as a rule, one in 2**octaves on each axis.
    """

    step: Step
    share: float = 1.0
    octaves: int = 0

    @property
    def every(self) -> int:
        """Of so many voxels on each axis one is drawn, by a step that draws all as a rule."""
        return 1 << self.octaves


def ladder(scene: Scene) -> list[Rung]:
    """All ways to draw a moving scene, the best one last."""
    *coarser, finest = PAPER_STEPS
    side = min(scene.image.width, scene.image.height)
    smaller = [Rung(finest, share) for share in SMALLER if share * side >= LEAST_SIDE]
    if not smaller:
        return [*map(Rung, coarser), Rung(finest)]
    strided = [smaller[0]._replace(octaves=octaves) for octaves in range(_MOST_OCTAVES, 0, -1)]
    return [*strided, *smaller, Rung(finest)]


class Pacing:
    """Running times of the rungs, in seconds, and the choice that follows from them."""

    def __init__(self, images_per_second: float = IMAGES_PER_SECOND) -> None:
        self._interval = 1 / images_per_second
        self._seconds: dict[Rung, float] = {}
        self._drawn: Rung | None = None  # what was measured last,
        self._began_at = 0.0  # and its time when the others were last in proportion to it
        self._moving = Rung(Step.A)

    def measured(self, rung: Rung, seconds: float) -> None:
        """Note the time of one image.

        What makes one much slower or faster (zoom, image size, tables) does so with all, so that those not drawn
        lately follow in proportion. What varies from image to image is no news of the others.
        """
        old = self._seconds.get(rung)
        new = seconds if old is None else old + _NEWEST_WEIGHT * (seconds - old)
        self._seconds[rung] = new
        if rung != self._drawn:
            self._drawn, self._began_at = rung, new
        change = new / self._began_at
        if not 1 / _NEWS <= change <= _NEWS:
            for other in self._seconds.keys() - {rung}:
                self._seconds[other] *= change
            self._began_at = new
        if rung.share == 1.0:  # what was slow once is not drawn again, and must not be thought slow for ever
            for other in self._seconds.keys() - {rung}:
                if other.step == rung.step:
                    self._seconds[other] = min(self._seconds[other], _SLACK * _of_whole(other, new))

    def expected(self, rung: Rung) -> float | None:
        """Seconds that it will take, as measured or as the same step's whole image lets expect; None if unknown."""
        whole = self._seconds.get(Rung(rung.step))
        return self._seconds.get(rung, None if whole is None else _of_whole(rung, whole))

    @property
    def moving(self) -> Rung:
        """What was chosen last."""
        return self._moving

    def while_moving(self, scene: Scene) -> Rung:
        """The best that holds the rate; what is the fastest if nothing is known to.

        What is drawn is kept until it takes too long, and left for a better one only if that will surely do: times
        vary, and an image that changes its looks with them flickers.
        """
        rungs = ladder(scene)
        drawn = rungs.index(self._moving) if self._moving in rungs else -1
        self._moving = rungs[0]
        for place, rung in enumerate(rungs):
            seconds = self.expected(rung)
            allowed = (1.0 if place <= drawn else _MARGIN) * (_LIT_PATIENCE if _is_smallest_lit(rungs, place) else 1.0)
            if seconds is not None and seconds <= allowed * self._interval:
                self._moving = rung
        return self._moving


def _of_whole(rung: Rung, seconds: float) -> float:
    """Likely seconds of an image whose step takes so many in the whole size."""
    return seconds * (_VOXELS_SHARE / rung.every + (1 - _VOXELS_SHARE) * rung.share**2)


def _is_smallest_lit(rungs: list[Rung], place: int) -> bool:
    """Whether this is the fastest way to draw all voxels by the finest step; anything coarser looks quite different."""
    return place == next(n for n, rung in enumerate(rungs) if rung.step == rungs[-1].step and rung.octaves == 0)
