"""The scene of a volume that nothing but its values is known of: chosen so that the picture is never empty."""

from dataclasses import dataclass

from volsplat.client.histogram.density_histogram import LAST, CtScale, DensityHistogram, otsu_byte, zero_position
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.label_colours import label_colour
from volsplat.client.scene.table_makers import GLOW, KEY_LIGHT, REFLECTION, colours, dimmed, opacities, scalars
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables

LEAST_SEEN, MOST_SEEN = 0.01, 0.60  # shares of the voxels between which the first picture stays if it can
AIMED_SEEN = 0.35  # at most, if the histogram shows no gap of its own
AIMED_SIGNS = 0.05  # at most, of data of both signs: more would be the noise about zero
SURFACE = 0.85  # opacity of what is seen: a few voxels hide what lies behind, so that form is told by light
RIM = 0.2  # opacity of the weakest sample that is seen
RISE = 0.2  # of the seen range: where SURFACE is reached, so that a surface is no staircase
DENSE_SHARE = 0.01  # of the seen voxels: the colours end where no more are denser
SKIN_HU = -300.0  # where the skin of a CT begins
MOST_LABELS = 32  # whole numbers up to here, each one a thing of its own


@dataclass(frozen=True)
class Seen:
    """The density bytes that are seen: those below `below` and those above `above`."""

    below: int
    above: int

    def share(self, histogram: DensityHistogram) -> float:
        return histogram.share_below(self.below) + histogram.share_above(self.above)


def histogram_scene(subject: Subject) -> Scene:
    """A CT if one is recognised or stated, labels if the values look like them, else what stands out."""
    histogram, scale = subject.histogram, _ct_of_a_body(subject)
    if scale is not None:
        return _skull_in_flesh(scale)
    if shows_labels(subject):
        seen, tint = _unusual(histogram), _label_tint(subject)
        opacity = _opacity(seen, histogram, rim=SURFACE)
    else:
        seen = seen_bytes(histogram)
        tint, opacity = _tint(seen, histogram), _opacity(seen, histogram, rim=RIM)
    return Scene(
        tables=Tables(emit=dimmed(tint, GLOW), refl=dimmed(tint, REFLECTION), opac=opacity),
        # Where data ends at voxels without a value, it may rise towards them as well as fall.
        shading=Shading(modulation=False, two_sided=seen.below > 0 or subject.has_gaps),
        light=KEY_LIGHT,
    )


def shows_labels(subject: Subject) -> bool:
    """Whether `histogram_scene` gives each whole number a colour of its own: one fills much of the volume."""
    histogram = subject.histogram
    return _are_labels(subject) and _ct_of_a_body(subject) is None and _well_seen(_unusual(histogram), histogram)


def _ct_of_a_body(subject: Subject) -> CtScale | None:
    """The scale of a CT whose skin shows. Stated units are believed if a body fills the grid, too."""
    scale = subject.ct
    if scale is None:
        return None
    skin = Seen(0, round(scale.position(SKIN_HU) * LAST))
    most = 1.0 if subject.in_hounsfield else MOST_SEEN
    return scale if LEAST_SEEN <= skin.share(subject.histogram) <= most else None


def _well_seen(seen: Seen, histogram: DensityHistogram) -> bool:
    return LEAST_SEEN <= seen.share(histogram) <= MOST_SEEN


def _skull_in_flesh(scale: CtScale) -> Scene:
    """A CT: bone as a solid surface, the skin as a veil about it; what does not change is clear."""
    at = scale.place
    return Scene(
        tables=Tables(
            emit=colours((at(-300), "#2a1811"), (at(100), "#3a251c"), (at(600), "#4a4436")),
            refl=colours((at(-300), "#a05c44"), (at(100), "#a8664e"), (at(300), "#c8bca0"), (at(1200), "#e0d8c0")),
            opac=opacities((at(SKIN_HU), 0.0), (at(-100), 0.22), (at(120), 0.22), (at(300), 0.9), (at(1000), 0.95)),
            modu=scalars((0.06, 0.0), (0.5, 1.0)),
        ),
        shading=Shading(specular_power=25.0),
        light=KEY_LIGHT,
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
        if _well_seen(candidate, histogram):
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
    return [next((seen for seen in sets if seen.share(histogram) <= AIMED_SIGNS), Seen(0, LAST))]


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


def _opacity(seen: Seen, histogram: DensityHistogram, rim: float) -> ScalarTable:
    """Nothing up to the seen bytes, then a steep rise from `rim`: a surface."""
    points: list[tuple[float, float]] = []
    if seen.below > 0:
        least = _least(seen, histogram)
        full = max(seen.below - 1 - round(RISE * (seen.below - least)), 0)
        points += [(full / LAST, SURFACE), ((seen.below - 1) / LAST, rim), (seen.below / LAST, 0.0)]
    if seen.above < LAST:
        most = _most(seen, histogram)
        full = min(seen.above + 1 + round(RISE * (most - seen.above)), LAST)
        points += [(seen.above / LAST, 0.0), ((seen.above + 1) / LAST, rim), (full / LAST, SURFACE)]
    return ScalarTable(points=tuple(points))


def _most(seen: Seen, histogram: DensityHistogram) -> int:
    """The byte above which no more than the densest hundredth of what is seen lies."""
    share = DENSE_SHARE * histogram.share_above(seen.above)
    return next(byte for byte in range(seen.above, LAST + 1) if histogram.share_above(byte) <= share)


def _least(seen: Seen, histogram: DensityHistogram) -> int:
    """The same at the other end."""
    share = DENSE_SHARE * histogram.share_below(seen.below)
    return next(byte for byte in range(seen.below, -1, -1) if histogram.share_below(byte) <= share)


def _tint(seen: Seen, histogram: DensityHistogram) -> ColourTable:
    """Warm above, from brown to ivory; cold below."""
    points: list[tuple[float, str]] = []
    if seen.below > 0:
        points += [(_least(seen, histogram) / LAST, "#4a86d8"), (seen.below / LAST, "#8fb4e0")]
    if seen.above < LAST:
        above, most = seen.above / LAST, _most(seen, histogram) / LAST
        points += [(above, "#b07858"), (above + (most - above) / 3, "#dca884"), (most, "#f4ead8")]
    return colours(*points)


def _are_labels(subject: Subject) -> bool:
    """Few whole numbers from 0 up, of a kind that nobody states."""
    low, high = subject.values.low, subject.values.high
    return subject.kind is Kind.UNKNOWN and subject.whole_numbers and 0 <= low < high <= MOST_LABELS


def _label_tint(subject: Subject) -> ColourTable:
    """A colour for each whole number, neighbours well apart."""
    labels = range(int(subject.values.low), int(subject.values.high) + 1)
    at = subject.histogram.position
    return ColourTable(points=tuple((at(label), label_colour(label)) for label in labels))
