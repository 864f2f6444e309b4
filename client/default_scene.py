"""The scene that a volume is first seen with: chosen from its histogram so that the picture is never empty."""

import math
from dataclasses import dataclass

from volsplat.client.density_histogram import LAST, DensityHistogram, density_histogram, otsu_byte, zero_position
from volsplat.client.presets import KEY_LIGHT, colours, dimmed
from volsplat.client.view_rotation import named_view
from volsplat.protocol.index_rules import Survey
from volsplat.protocol.scene import ColourTable, ScalarTable, Scene, Shading, Tables, View
from volsplat.protocol.volume import VolumeDescription

LEAST_SEEN, MOST_SEEN = 0.01, 0.60  # shares of the voxels between which the first picture stays where it can
AIMED_SEEN = 0.35  # at most, where the histogram shows no gap of its own
OPAQUE = 0.97  # what the first third of a ray through the seen voxels should add up to, on average
LEAST_OPACITY, MOST_OPACITY = 0.02, 0.7  # of the strongest sample
WEAKEST = 0.15  # of that, for the weakest sample that is seen


@dataclass(frozen=True)
class Seen:
    """The density bytes that are seen: those below `below` and those above `above`."""

    below: int
    above: int

    def share(self, histogram: DensityHistogram) -> float:
        return histogram.share_below(self.below) + histogram.share_above(self.above)


def default_scene(
    description: VolumeDescription, survey: Survey, density_counts: list[int], window: tuple[float, float]
) -> Scene:
    """A scene for a volume that nothing but its survey is known of. `density_counts` split survey.low..survey.high."""
    histogram = density_histogram(survey, density_counts, window)
    seen = seen_bytes(histogram)
    mean_side = description.geometry.box.voxels ** (1 / 3)
    return Scene(
        tables=Tables(
            emit=dimmed(_tint(seen), 0.45),
            refl=dimmed(_tint(seen), 0.75),
            opac=_opacity(seen, _strongest(seen.share(histogram) * mean_side / 3)),
        ),
        shading=Shading(modulation=False, two_sided=seen.below > 0),
        light=KEY_LIGHT,
        view=View(rotation=named_view("front")),
    )


def seen_bytes(histogram: DensityHistogram) -> Seen:
    """What to show: the dense part, or both signs, or whatever differs from the most frequent value.

    Its share lies between LEAST_SEEN and MOST_SEEN unless one density byte holds almost all voxels. Then the few
    others are shown, and of a constant volume everything.
    """
    occupied = [byte for byte, count in enumerate(histogram.counts) if count]
    if not occupied:
        return Seen(below=0, above=0)
    if len(occupied) == 1:
        return Seen(below=0, above=occupied[0] - 1) if occupied[0] else Seen(below=1, above=LAST)
    candidates = [*_both_signs(histogram), *_dense(histogram), *_sparse(histogram), _unusual(histogram)]
    for candidate in candidates:
        if LEAST_SEEN <= candidate.share(histogram) <= MOST_SEEN:
            return candidate
    return candidates[-1]


def _both_signs(histogram: DensityHistogram) -> list[Seen]:
    """For data around zero with something on either side: the strongest of both."""
    zero = zero_position(histogram)
    if zero is None:
        return []
    middle = round(zero * LAST)
    if min(histogram.share_below(middle), histogram.share_above(middle)) < LEAST_SEEN:
        return []
    reach = max(middle, LAST - middle)
    sets = (Seen(max(middle - n, 0), min(middle + n, LAST)) for n in range(reach))
    return [next((seen for seen in sets if seen.share(histogram) <= AIMED_SEEN), Seen(0, LAST))]


def _dense(histogram: DensityHistogram) -> list[Seen]:
    """Above the valley of the histogram; else above the least byte that leaves no more than is aimed at."""
    valley = otsu_byte([float(count) for count in histogram.counts])
    aimed = [Seen(0, n) for n in range(LAST) if histogram.share_above(n) <= AIMED_SEEN]
    most = [Seen(0, n) for n in range(LAST) if histogram.share_above(n) <= MOST_SEEN]
    return [Seen(0, valley), *aimed[:1], *most[:1]]


def _sparse(histogram: DensityHistogram) -> list[Seen]:
    """The same from the other end, for objects that are less dense than what surrounds them."""
    most = [Seen(n, LAST) for n in range(LAST, 0, -1) if histogram.share_below(n) <= MOST_SEEN]
    return most[:1]


def _unusual(histogram: DensityHistogram) -> Seen:
    """All but the most frequent byte."""
    mode = max(range(LAST + 1), key=lambda byte: histogram.counts[byte])
    return Seen(mode, mode)


def _strongest(samples: float) -> float:
    """The opacity of the densest sample, for rays that meet this many seen samples on average."""
    opacity = 1 - math.pow(1 - OPAQUE, 1 / max(samples, 1.0))
    return min(max(opacity, LEAST_OPACITY), MOST_OPACITY)


def _opacity(seen: Seen, strongest: float) -> ScalarTable:
    points: list[tuple[float, float]] = []
    if seen.below > 0:
        points += [(0.0, strongest), ((seen.below - 1) / LAST, strongest * WEAKEST), (seen.below / LAST, 0.0)]
    if seen.above < LAST:
        points += [(seen.above / LAST, 0.0)] if seen.above >= 0 else []
        points += [((seen.above + 1) / LAST, strongest * WEAKEST), (1.0, strongest)]
    return ScalarTable(points=tuple(points))


def _tint(seen: Seen) -> ColourTable:
    below, above = max(seen.below, 0) / LAST, min(max(seen.above, 0), LAST) / LAST
    cold = [(0.0, "#4a86d8"), (below, "#b8c4d0")] if seen.below > 0 else []
    warm = [(above, "#a08878"), (above + (1 - above) / 3, "#d8a888"), (1.0, "#f4ead8")] if seen.above < LAST else []
    return colours(*cold, *warm)
