"""What to draw while things move: the best picture that holds the wanted rate, from measured times.

Best is the finest of the paper's steps that the scene asks for, in as large an image as can be: in half the width and
height it is more like the finished picture than a coarser step of the whole size. Where that takes too long, voxels are
left out: first every other sheet, one behind the other as they lie, then rows as well, in an ever smaller image, whose
footprints take fewer pixels. All but the whole image leave out what almost opaque pixels hide, and cut the kernel
nearer, which is cheaper and blurs less. So the ladder rises by what was measured to be like the finished picture, and
costs rise with it (docs/notes/performance_log.md); what costs as much as something more alike is not on it. Steps
without footprints are drawn as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from msgspec.structs import replace

from volsplat.client.ui.viewing.image_size import scaled
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Kernel, Scene
from volsplat.protocol.rules.footprint_shape import kernel_radius
from volsplat.protocol.rules.levels import ALL_VOXELS, Thinning
from volsplat.protocol.rules.refinement import PAPER_STEPS, STEP_RULES, finest_paper_step

INTERVAL = 1 / 30.0  # seconds between two images while they move
SMALLER = (0.25, 0.375, 0.5, 0.75)  # images, as shares of the width and of the height
LEAST_SIDE = 160  # pixels of a smaller image
LEAST_THINNED_SIDE = 128  # of one in which so much is left out that its pixels hide nothing
# What is left out, the most first: in the smallest of such images, and in the next larger one; there the last also in
# the one after.
FEWEST = (Thinning(octaves=2), Thinning(sheets=4, rows=4), Thinning(sheets=3, rows=3), Thinning(sheets=2, rows=2))
FEWER = (Thinning(sheets=2, rows=2), Thinning(sheets=2))
ALMOST_OPAQUE = 1.0 - 1.0 / 32.0  # a pixel's alpha: what lies behind is not seen while it moves
NEAR_CUT = 1.5  # voxels: where the Gaussian kernel is cut while it moves
_NEWEST_WEIGHT = 0.2  # of the newest time in the running mean
_LEARNT = 6  # images, after which it is known what a rung costs beside the one before
_LEAST = 2  # images, before another rung is taken
_LEARN_TO = 2.0  # by which factor a cost may turn out to be other than is likely
_FORGOTTEN = 0.005  # of what was learnt, with each image
_HICCUP = 2.0  # times as long as expected: an image that takes more is no news,
_RARE = 10  # if so many before it did not
_MARGIN = 0.85  # of the time between two images that a better one may take,
_KEPT = 0.9  # and what is drawn already: its way to the canvas takes time, too
_VOXELS_SHARE = 0.5  # of a step's time, which a smaller image does not save, and fewer voxels save
_FEWER_SAVE = 0.6  # power of the share of the voxels, of which that time is


class Rung(NamedTuple):
    """One way to draw: a step, in an image whose width and height are this share of the scene's."""

    step: Step
    share: float = 1.0
    thinning: Thinning = ALL_VOXELS

    @property
    def is_whole(self) -> bool:
        return self.share == 1.0 and self.thinning == ALL_VOXELS

    @property
    def left_out(self) -> Thinning:
        """All that is left out; nothing of a whole image, which may stay."""
        return self.thinning if self.is_whole else self.thinning._replace(frozen_alpha=ALMOST_OPAQUE)

    def drawn(self, scene: Scene) -> Scene:
        """The scene as it is drawn in passing; a whole image is the scene's own."""
        return scene if self.is_whole else scaled(_cut_near(scene), self.share)


def ladder(scene: Scene) -> list[Rung]:
    """All ways to draw a moving scene, the best one last."""
    finest, side = finest_paper_step(scene), min(scene.image.width, scene.image.height)
    if not STEP_RULES[finest].footprint:  # each is far cheaper than the next
        return [Rung(step) for step in PAPER_STEPS if step <= finest]
    shares = [*(share for share in SMALLER if share * side >= LEAST_SIDE), 1.0]
    smallest = next((share for share in SMALLER if share * side >= LEAST_THINNED_SIDE), 1.0)
    thinned = [Rung(finest, smallest, thinning) for thinning in FEWEST]
    thinned += [
        Rung(finest, shares[0], thinning) for thinning in FEWER if (shares[0], thinning) != (smallest, FEWEST[-1])
    ]
    # All voxels cost as much in the smallest of these images as in the next, since more of them share a pixel.
    larger = [Rung(finest, share, FEWER[-1]) for share in shares[1:2]]
    return [*thinned, *larger, *(Rung(finest, share) for share in shares[1:] or shares)]


def _cut_near(scene: Scene) -> Scene:
    """With the default kernel cut nearer; the others would change their shape."""
    drawn = scene.reconstruction
    if drawn.kernel is not Kernel.GAUSSIAN or kernel_radius(drawn) <= NEAR_CUT:
        return scene
    return replace(scene, reconstruction=replace(drawn, radius=NEAR_CUT))


class Pacing:
    """What each rung costs, how fast the machine is at present, and the choice that follows from them.

    What makes one rung slower or faster (zoom, tables, other programs) does so with all of them: that is the pace, in
    seconds for a whole image, which follows all that is measured. Costs, in whole images, are what rungs are beside
    each other: the first images after a change of rungs tell them, since the pace is known from just before. After a
    rest it is not, for a picture at rest is held up by a page that takes in another one: so the first images tell it.
    """

    def __init__(self) -> None:
        self._pace: dict[Step, float] = {}
        self._costs: dict[Rung, float] = {}  # that were learnt
        self._drawn: Rung | None = None  # what was measured last while things moved; None after a rest,
        self._images = 0  # and how often in a row
        self._first = True  # whether it is the first that was drawn after a rest
        self._even = _RARE  # images since one took far longer than expected, or at least so many
        self._moving = Rung(PAPER_STEPS[-1])

    def measured_at_rest(self, step: Step, seconds: float) -> None:
        """Note the time of one whole image that may stay."""
        self._drawn, self._images, self._even = None, 0, _RARE
        pace = self._pace.get(step)
        if pace is None or not pace < seconds <= _HICCUP * pace:  # pages that take in the one before may hold it up
            self._pace[step] = seconds
        self._forget(step, 0.5)

    def measured(self, rung: Rung, seconds: float) -> None:
        """Note the time of one image while things move."""
        if rung != self._drawn:
            self._first, self._images = self._drawn is None, 0
        self._drawn = rung
        pace = self._pace.get(rung.step)
        if pace is None:
            self._pace[rung.step] = seconds / self._cost(rung)
            return
        slow, even = seconds > _HICCUP * pace * self._cost(rung), self._even
        self._even = 0 if slow else even + 1
        if slow and even >= _RARE:
            return
        self._images += 1
        if rung.is_whole:
            self._pace[rung.step] = math.sqrt(pace * seconds)
            self._forget(rung.step, 0.5)
            return
        may_learn = self._images <= _LEARNT and not self._first
        if not (may_learn and self._learns(rung, seconds / pace)):
            weight = max(_NEWEST_WEIGHT, 1 / (1 + self._images)) if self._first else _NEWEST_WEIGHT
            self._pace[rung.step] = pace + weight * (seconds / self._cost(rung) - pace)
        self._forget(rung.step, _FORGOTTEN)

    def expected(self, rung: Rung) -> float | None:
        """Seconds that it will take; None if nothing is known of its step."""
        pace = self._pace.get(rung.step)
        return None if pace is None else pace * self._cost(rung)

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
        if self._moving not in rungs or self._images_learnt >= _LEAST:
            self._moving = self._chosen(rungs)
        return self._moving

    @property
    def _images_learnt(self) -> float:
        """How often what moves was drawn as it is now; a whole image tells all with one."""
        if self._moving.is_whole or self._moving != self._drawn:
            return math.inf
        return self._images

    def _chosen(self, rungs: list[Rung]) -> Rung:
        drawn = rungs.index(self._moving) if self._moving in rungs else -1
        better = self._images_learnt >= _LEARNT
        chosen = rungs[0]
        for place, rung in enumerate(rungs if better else rungs[: drawn + 1]):
            seconds = self.expected(rung)
            if seconds is not None and seconds <= INTERVAL * (_KEPT if place <= drawn else _MARGIN):
                chosen = rung
        return chosen

    def _cost(self, rung: Rung) -> float:
        return self._costs.get(rung, _likely_cost(rung))

    def _learns(self, rung: Rung, cost: float) -> bool:
        """Take in what it cost now; False if that is rather the machine's doing."""
        known, likely = 0.0 if self._images == 1 else self._cost(rung), _likely_cost(rung)
        mean = known + (cost - known) / self._images
        self._costs[rung] = min(max(mean, likely / _LEARN_TO), likely * _LEARN_TO)
        return self._costs[rung] == mean

    def _forget(self, step: Step, part: float) -> None:
        """What was slow once is not drawn again, and must not be thought slow for ever."""
        for rung, cost in self._costs.items():
            if rung.step == step:
                self._costs[rung] = cost ** (1 - part) * _likely_cost(rung) ** part


def _likely_cost(rung: Rung) -> float:
    """In whole images."""
    voxels = 1 / rung.thinning.one_in
    return _VOXELS_SHARE * math.pow(voxels, _FEWER_SAVE) + (1 - _VOXELS_SHARE) * rung.share**2
