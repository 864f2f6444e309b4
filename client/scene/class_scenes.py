"""Scenes of volumes whose values are classes: labels, chemical elements, phases in bands."""

from volsplat.client.histogram.density_histogram import LAST
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.label_colours import label_colour
from volsplat.client.scene.table_makers import GLOW, KEY_LIGHT, REFLECTION, dimmed, scalars
from volsplat.protocol.description.colours import Colour, colour_from_hex
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable, Tables

SURFACE = 0.85
RIM = 0.35  # opacity of a band's lowest value, which is an atom's rim

# After Corey, Pauling and Koltun, as molecules are drawn everywhere; metals and all the rest in one colour.
CPK = {
    "bond": "#8c8c8c",
    "H": "#f0f0f0",
    "C": "#909090",
    "N": "#3454e0",
    "O": "#e02c24",
    "P": "#f08c1c",
    "S": "#e8d030",
    "other": "#d060c0",
}


def classes_scene(subject: Subject) -> Scene | None:
    """Each class in its colour, solid; None if the file does not tell the classes and nothing lets guess them."""
    bands = classes_of(subject)
    if not bands:
        return None
    table = class_colours(subject, bands)
    rises = subject.kind is Kind.ELEMENTS
    clear_from, points = (1, [(0.0, 0.0)]) if _background_is_below_window(subject, bands) else (0, [])
    for band in bands:
        start, end = class_bytes(subject, band)
        start, end = max(start, clear_from), max(end, clear_from)  # of classes too near for bytes each has the next
        if start > LAST:
            break
        if start > clear_from:
            points += [(clear_from / LAST, 0.0), ((start - 1) / LAST, 0.0)]
        points += [(start / LAST, RIM if rises and end > start else SURFACE)]
        points += [((start + (end - start) // 4) / LAST, SURFACE), (end / LAST, SURFACE)]
        clear_from = end + 1
    if clear_from <= LAST:
        points += [(clear_from / LAST, 0.0), (1.0, 0.0)]
    return Scene(
        tables=Tables(emit=dimmed(table, GLOW), refl=dimmed(table, REFLECTION), opac=scalars(*points)),
        shading=Shading(modulation=False, specular_power=40.0),
        light=KEY_LIGHT,
    )


def _background_is_below_window(subject: Subject, bands: tuple[Band, ...]) -> bool:
    """Then the first entry is that of the background, too, and no class may have it."""
    return subject.values.low < min(subject.histogram.window[0], bands[0].low)


def class_colours(subject: Subject, bands: tuple[Band, ...]) -> ColourTable:
    """A step of the table for each class."""
    points: list[tuple[float, Colour]] = []
    for band in sorted(bands, key=lambda band: band.low):
        start, end = class_bytes(subject, band)
        colour = _colour(subject, band)
        points += [(start / LAST, colour), (end / LAST, colour)]
    return ColourTable(points=tuple(points))


def _colour(subject: Subject, band: Band) -> Colour:
    if band.colour is not None:
        return band.colour
    if subject.kind is Kind.ELEMENTS:
        return colour_from_hex(CPK.get(band.name, CPK["other"]))
    return label_colour(round(band.low))


def class_bytes(subject: Subject, band: Band) -> tuple[int, int]:
    """The density bytes of a band, both included."""
    at = subject.histogram.position
    return round(at(band.low) * LAST), round(at(band.high) * LAST)


def classes_of(subject: Subject) -> tuple[Band, ...]:
    """Those that the file tells, by value; else each whole number above 0, as far as bytes tell them apart.

    0 is the background.
    """
    if subject.bands:
        return tuple(sorted(subject.bands, key=lambda band: band.low))
    first = max(int(subject.values.low), 1)
    last = min(int(subject.values.high), first + TABLE_ENTRIES)
    return tuple(Band(str(n), n, n) for n in range(first, last + 1))
