"""What a first picture is worth without an eye: that something is there, framed, with a form, no block and no noise.

All are shares, by the luminance over the background. The limits lie between what pictures have that a person found
good and what spoilt ones have; the tests beside this file draw both.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
SEEN = 0.03  # difference of a channel to the background, of which an eye sees something
LEAST_COVER = 0.04  # a long molecule has a tenth
LEAST_LONGER_SIDE, MOST_LONGER_SIDE = 0.75, 0.97  # of an outline in blocks, some of which show next to nothing
VARIED = 2 / 255  # a difference between neighbours that is no plain face
LEAST_VARIED = 0.5
WHITE = 0.99
MOST_WHITE = 0.05
MOST_FILLED = 0.955
COARSE = 6  # voxels: what is larger is form
LEAST_FORM = 0.32


class Score(NamedTuple):
    """Of an empty picture all are 0."""

    cover: float  # of the picture, where something is seen
    longer_side: float  # of what is seen, of the picture's
    at_frame: float  # of the frame's pixels, where something is seen
    varied: float  # of what is seen, where neighbours differ
    white: float  # of what is seen
    filled: float  # of the upright rectangle about what is seen: 1 for a block from the front
    form: float  # of the light's variance, what is left of it in means over COARSE voxels: noise averages out

    def faults(self, block: bool = False, grain: bool = False) -> list[str]:
        """In words, with what was measured; none for a picture that is worth looking at.

        What is a `block` by nature fills its outline, and `grain`, as of a molecule's atoms, is all smaller than COARSE
        voxels.
        """
        if self.cover == 0.0:
            return ["empty"]
        checks = {
            f"little: covers {self.cover:.3f} of the picture": self.cover >= LEAST_COVER,
            f"small: longer side {self.longer_side:.2f}": self.longer_side >= LEAST_LONGER_SIDE,
            f"large: longer side {self.longer_side:.2f}": self.longer_side <= MOST_LONGER_SIDE,
            f"cut: at {self.at_frame:.3f} of the frame": self.at_frame == 0.0,
            f"plain: {self.varied:.2f} varied": self.varied >= LEAST_VARIED,
            f"burnt out: {self.white:.2f} white": self.white <= MOST_WHITE,
            f"block: fills {self.filled:.2f} of its outline": block or self.filled <= MOST_FILLED,
            f"noise: {self.form:.2f} is form": grain or self.form >= LEAST_FORM,
        }
        return [told for told, good in checks.items() if not good]


def score(
    picture: NDArray[np.float32], voxel: float = 1.0, background: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Score:
    """Of (H, W, 3), 0..1, in which a voxel is so many pixels wide."""
    seen = np.abs(picture - np.array(background, np.float32)).max(axis=2) > SEEN
    if not seen.any():
        return Score(*[0.0] * len(Score._fields))
    light = picture @ LUMINANCE
    sides = [int(np.ptp(places)) + 1 for places in np.nonzero(seen)]
    return Score(
        cover=float(seen.mean()),
        longer_side=max(sides) / max(seen.shape),
        at_frame=float(np.concatenate((seen[0], seen[-1], seen[1:-1, 0], seen[1:-1, -1])).mean()),
        varied=_varied(light, seen),
        white=float((picture.min(axis=2) > WHITE)[seen].mean()),
        filled=float(seen.sum()) / (sides[0] * sides[1]),
        form=_form(light, seen, max(round(COARSE * voxel), 2)),
    )


def _varied(light: NDArray[np.float32], seen: NDArray[np.bool_]) -> float:
    """Without the rim of what is seen, if there is more than a rim."""
    around = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]
    lights = [np.roll(light, shift, (0, 1)) for shift in around]
    inner = np.all([np.roll(seen, shift, (0, 1)) for shift in around], axis=0)
    spread = np.max(lights, axis=0) - np.min(lights, axis=0)
    return float((spread > VARIED)[inner if inner.any() else seen].mean())


def _form(light: NDArray[np.float32], seen: NDArray[np.bool_], window: int) -> float:
    variance = float(light[seen].var())
    if variance == 0.0:
        return 0.0
    means = _window_sums(light * seen, window) / np.maximum(_window_sums(seen.astype(np.float32), window), 1.0)
    return float(means[seen].var()) / variance


def _window_sums(values: NDArray[np.float32], window: int) -> NDArray[np.float64]:
    """Over the square of `window` pixels about each pixel, nothing beyond the picture."""
    before, after = window // 2, window - window // 2
    padded = np.pad(values.astype(np.float64), ((before, after), (before, after)))
    sums = np.pad(padded.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    height, width = values.shape
    low, high = slice(0, height), slice(window, window + height)
    left, right = slice(0, width), slice(window, window + width)
    total: NDArray[np.float64] = sums[high, right] - sums[low, right] - sums[high, left] + sums[low, left]
    return total
