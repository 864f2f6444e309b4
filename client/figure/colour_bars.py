"""The colours and opacities of a scene's tables over the data's values, below a picture; of classes a legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from volsplat.client.figure.axis_ticks import tick_texts, ticks
from volsplat.client.figure.drawing import Anchor, Area, Box, Line, Ramp, Shape, Words
from volsplat.client.figure.type_faces import size_within, width_of
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.class_scenes import class_bytes, classes_of, classes_scene
from volsplat.client.scene.default_scene import is_shown_as_labels
from volsplat.client.volume.clearest_entries import clearest_entries
from volsplat.client.volume.field_axis import FieldAxis, field_axis
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.kind import CLASS_KINDS, Band, Kind
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import GRID_FIELDS, TABLE_ENTRIES, Field
from volsplat.protocol.description.volume import GridAxis

LAST = TABLE_ENTRIES - 1
ROUNDING = 1e-6  # of a table's entry
ALIKE = 1.5 / 255  # by how much colours that count as the same differ
LEAST_OPACITY = 0.01  # of what is worth a place in a legend
MOST_CLASSES = 128  # in one; of more there is a bar
INSET = 1.2  # ems, from the figure's sides to an axis
GAP = 0.6  # ems, above each axis
CURVE, STRIP, TICK, TICK_LINE, HEADING_LINE = 2.2, 0.9, 0.3, 1.2, 1.3  # ems, each below the one before
STRIP_TEXT = 0.8  # of the size of other words
TICK_SPACING, LEAST_TICKS = 5.0, 3  # ems, at least from tick to tick where there is room for more
SPARE = 1.2  # the room that a line may take where SVG is set in a wider font, over what it takes in ours
LEGEND_LINE, SWATCH = 1.5, 0.8  # ems
CURVE_OPACITY = 0.3


@dataclass(frozen=True)
class Strip:
    """Colours along an axis."""

    name: str  # "" if there is no other one beside it
    colours: tuple[Colour, ...]


@dataclass(frozen=True)
class AxisBar:
    """One axis: the colours and the opacities that lie along it."""

    axis: FieldAxis
    strips: tuple[Strip, ...]
    opacities: tuple[float, ...] | None

    def height(self, width: int, em: int) -> float:
        """In ems."""
        curve = CURVE if self.opacities else 0.0
        lines = HEADING_LINE * len(self.headings(width, em))
        return GAP + curve + STRIP * len(self.strips) + TICK + TICK_LINE + lines

    def headings(self, width: int, em: int) -> list[str]:
        """What the axis and the curve are: in one line, or in two where one would be too long."""
        axis = self.axis
        words = f"{axis.label} ({axis.unit})" if axis.unit else axis.label
        if self.opacities is None:
            return [words]
        curve = f"curve: opacity, 0 to {max(self.opacities):.3g}"
        both = f"{words}; {curve}"
        return [both] if SPARE * width_of(both, em) <= width - em else [words, curve]


@dataclass(frozen=True)
class ColourBars:
    """What is below a picture."""

    bars: tuple[AxisBar, ...]
    legend: tuple[tuple[str, Colour], ...]  # names of classes and their colours

    def height(self, width: int, em: int) -> int:
        """Pixels."""
        rows = len(_rows(self.legend, width, em))
        ems = sum(bar.height(width, em) for bar in self.bars) + (rows * LEGEND_LINE + GAP if rows else 0.0)
        return round((ems + GAP) * em) if ems else 0

    def shapes(self, top: float, width: int, em: int, ink: Colour) -> list[Shape]:
        """Over the figure's whole width, from `top` down."""
        shapes: list[Shape] = []
        for bar in self.bars:
            shapes += _bar_shapes(bar, top, width, em, ink)
            top += bar.height(width, em) * em
        for n, row in enumerate(_rows(self.legend, width, em)):
            base = top + (GAP + LEGEND_LINE * (n + 0.7)) * em
            for x, (name, colour) in row:
                side, rim, upper = SWATCH * em, max(round(em / 14), 1), base - SWATCH * em * 0.9
                shapes.append(Box(x, upper, side, side, ink))  # else white on white would not be seen
                inner = max(side - 2 * rim, 0.0)
                shapes.append(Box(x + rim, upper + rim, inner, inner, colour))
                shapes.append(Words(x + 1.2 * em, base, name, em, ink))
        return shapes


NONE = ColourBars((), ())


def colour_bars(scene: Scene, volume: SurveyedVolume, of_several: bool = False) -> ColourBars:
    """Of what the scene's switches let be seen; of a 2-D table, by density, what is most opaque of its strengths.

    `of_several`: other volumes are shown with the same scene, so that nothing is left out for not being in this one.
    """
    if scene.plane.patches:
        return _of_plane(scene, volume, of_several)
    classes = _classes(scene, volume, of_several)
    if classes:
        return ColourBars((), classes)
    strips: dict[Field, list[Strip]] = {}
    for field, strip in _strips(scene):
        strips.setdefault(field, []).append(strip)
    opac = scene.cross_bar.opac
    fields = list(dict.fromkeys([*strips, opac]))
    bars = (
        AxisBar(
            field_axis(volume, field, scene.quantise),
            tuple(strips.get(field, ())),
            tuple(scene.tables.opac.entries()) if field is opac else None,
        )
        for field in fields
    )
    return ColourBars(tuple(_told(bar, volume, of_several) for bar in bars), ())


def _of_plane(scene: Scene, volume: SurveyedVolume, of_several: bool) -> ColourBars:
    entries = clearest_entries(scene.plane.patches)
    emitted, reflected = tuple(entry.emit for entry in entries), tuple(entry.refl for entry in entries)
    strips = _strips_of(scene, (Field.DENSITY, emitted), (Field.DENSITY, reflected))
    axis = field_axis(volume, Field.DENSITY, scene.quantise)
    opacities = tuple(entry.opacity for entry in entries)
    bar = AxisBar(axis, tuple(strip for _, strip in strips), opacities)
    return ColourBars((_told(bar, volume, of_several),), ())


def _told(bar: AxisBar, volume: SurveyedVolume, of_several: bool) -> AxisBar:
    """As a person reads it: densities as far as there are any, grid indices as what the file says they stand for."""
    if bar.axis.field is Field.DENSITY:
        return bar if of_several else _as_far_as_data(bar, volume.survey.low, volume.survey.high)
    axes = volume.description.axes
    return _along(bar, axes[GRID_FIELDS.index(bar.axis.field)]) if axes and bar.axis.field in GRID_FIELDS else bar


def _as_far_as_data(bar: AxisBar, low: float, high: float) -> AxisBar:
    """Without the entries at the ends that stand for values which no voxel has; all if that leaves no range."""
    axis = bar.axis
    step = (axis.high - axis.low) / LAST
    first = max(math.floor((low - axis.low) / step + ROUNDING), 0)
    last = min(math.ceil((high - axis.low) / step - ROUNDING), LAST)
    if not low < high or not first < last:
        return bar
    part = slice(first, last + 1)
    return AxisBar(
        replace(axis, low=axis.low + first * step, high=axis.high - (LAST - last) * step),
        tuple(Strip(strip.name, strip.colours[part]) for strip in bar.strips),
        bar.opacities and bar.opacities[part],
    )


def _along(bar: AxisBar, told: GridAxis) -> AxisBar:
    """Rising to the right."""
    axis, strips, opacities = bar.axis, bar.strips, bar.opacities
    low, high = (told.first + index * told.step for index in (axis.low, axis.high))
    if low < high:
        return AxisBar(FieldAxis(axis.field, told.name, low, high, told.unit), strips, opacities)
    turned = tuple(Strip(strip.name, strip.colours[::-1]) for strip in strips)
    return AxisBar(FieldAxis(axis.field, told.name, high, low, told.unit), turned, opacities and opacities[::-1])


def _strips(scene: Scene) -> list[tuple[Field, Strip]]:
    tables, bus = scene.tables, scene.cross_bar
    return _strips_of(scene, (bus.emit, tuple(tables.emit.entries())), (bus.refl, tuple(tables.refl.entries())))


def _strips_of(
    scene: Scene, emit: tuple[Field, tuple[Colour, ...]], refl: tuple[Field, tuple[Colour, ...]]
) -> list[tuple[Field, Strip]]:
    """One of what is given off and reflected together where both differ by a factor alone, else one of each."""
    emitted = emit[1] if scene.shading.emitted else ()
    reflected = refl[1] if scene.shading.diffuse or scene.shading.specular else ()
    if not _seen(reflected):
        return [(emit[0], Strip("", emitted))] if _seen(emitted) else []
    if not _seen(emitted):
        return [(refl[0], Strip("", reflected))]
    if emit[0] is refl[0] and _proportional(emitted, reflected):
        both = tuple(
            (min(a[0] + b[0], 1.0), min(a[1] + b[1], 1.0), min(a[2] + b[2], 1.0))
            for a, b in zip(emitted, reflected, strict=True)
        )
        return [(emit[0], Strip("", both))]
    return [(emit[0], Strip("emitted", emitted)), (refl[0], Strip("reflected", reflected))]


def _seen(colours: Sequence[Colour]) -> bool:
    return any(map(any, colours))


def _proportional(a: Sequence[Colour], b: Sequence[Colour]) -> bool:
    factors = [1.0 / max(channel for colour in colours for channel in colour) for colours in (a, b)]
    return all(
        abs(x * factors[0] - y * factors[1]) <= ALIKE
        for one, other in zip(a, b, strict=True)
        for x, y in zip(one, other, strict=True)
    )


def _classes(scene: Scene, volume: SurveyedVolume, of_several: bool) -> tuple[tuple[str, Colour], ...]:
    """Names (or numbers) and colours of the classes that are there and not transparent, if the tables are by them."""
    bus = scene.cross_bar
    if not volume.has_values or {bus.emit, bus.refl, bus.opac} != {Field.DENSITY}:
        return ()
    subject = volume.subject(scene.quantise)
    bands, strips, opacities = _bands(scene, subject), _strips(scene), scene.tables.opac.entries()
    if not bands or not strips:
        return ()
    counts, colours = subject.histogram.counts, strips[-1][1].colours
    told = []
    for band in bands:
        low, high = class_bytes(subject, band)
        is_there = of_several or any(counts[low : high + 1])
        if is_there and max(opacities[low : high + 1]) >= LEAST_OPACITY:
            told.append((band.name, colours[(low + high) // 2]))
    return tuple(told) if len(told) <= MOST_CLASSES else ()


def _bands(scene: Scene, subject: Subject) -> tuple[Band, ...]:
    """Classes that the volume's values are stated to be, are taken for if nothing is stated, or are shown as."""
    if subject.kind in CLASS_KINDS:
        return classes_of(subject)
    if is_shown_as_labels(subject):
        return tuple(Band(str(n), n, n) for n in range(int(subject.values.low), int(subject.values.high) + 1))
    as_labels = replace(subject, kind=Kind.LABELS)
    preset = classes_scene(as_labels)
    coloured = preset is not None and preset.tables.refl == scene.tables.refl
    return classes_of(as_labels) if coloured else ()


def _rows(legend: Sequence[tuple[str, Colour]], width: int, em: int) -> list[list[tuple[float, tuple[str, Colour]]]]:
    """Each entry with its place in its row."""
    rows: list[list[tuple[float, tuple[str, Colour]]]] = []
    x = float(width)
    for entry in legend:
        needed = width_of(entry[0], em) + 2.4 * em
        if x + needed > width - INSET * em or not rows:
            rows.append([])
            x = INSET * em
        rows[-1].append((x, entry))
        x += needed
    return rows


def _bar_shapes(bar: AxisBar, top: float, width: int, em: int, ink: Colour) -> list[Shape]:
    left, across = INSET * em, width - 2 * INSET * em
    y = top + GAP * em
    shapes: list[Shape] = []
    if bar.opacities:
        most = max(bar.opacities)
        shares = tuple(opacity / most if most > 0 else 0.0 for opacity in bar.opacities)
        shapes.append(Area(left, y, across, CURVE * em, shares, ink, CURVE_OPACITY))
        y += CURVE * em
    hair = max(round(em / 14), 1)
    for strip in bar.strips:
        shapes.append(Ramp(left, y, across, STRIP * em, strip.colours))
        if strip.name:
            shade = sum(strip.colours[0]) < 1.5
            on = (1.0, 1.0, 1.0) if shade else (0.0, 0.0, 0.0)
            size = round(STRIP_TEXT * em)
            shapes.append(Words(left + 0.3 * em, y + 0.68 * em, strip.name, size, on, strip.colours[0]))
        y += STRIP * em
    shapes.append(Line(left, y, left + across, y, hair, ink))
    low, high = bar.axis.low, bar.axis.high
    values = ticks(low, high, max(int(across / (TICK_SPACING * em)), LEAST_TICKS))
    for value, text in zip(values, tick_texts(values), strict=True):
        x = left + (value - low) / (high - low) * across
        shapes.append(Line(x, y, x, y + TICK * em, hair, ink))
        shapes.append(Words(x, y + (TICK + 0.95) * em, text, em, ink, None, Anchor.MIDDLE))
    base = y + (TICK + TICK_LINE + 0.95) * em
    for n, heading in enumerate(bar.headings(width, em)):
        size = size_within(heading, em, width - em)
        shapes.append(Words(width / 2, base + n * HEADING_LINE * em, heading, size, ink, None, Anchor.MIDDLE))
    return shapes
