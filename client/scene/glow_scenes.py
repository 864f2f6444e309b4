"""Scenes of what has no surfaces: spectral cubes, which glow, and structure factors, points coloured by phase."""

from collections import Counter

from volsplat.client.histogram.density_histogram import LAST, landmarks
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.class_scenes import class_bytes
from volsplat.client.scene.table_makers import colours, opacities, scalars
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Reconstruction, Scene, Shading
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables

GLOWING = Shading(diffuse=False, specular=False, modulation=False)
DARK = colours((0.0, "#000000"))

APPROACHING_TO_RECEDING = ("#4060ff", "#58c8e8", "#e8e8d0", "#f0b048", "#f04030")
PLACES = (0.0, 0.35, 0.5, 0.65, 1.0)
CLEAR_NOISE = 3.0  # deviations of the noise: what is weaker is not shown
BRIGHTEST = 0.01  # of the signal is as opaque as it gets
LEAST_SIGNAL = 0.001  # of the voxels lie above that, or it is no noise that lies below 0

# The wheel of phases from 0 degrees up, and round again: red, yellow, green, cyan, blue, magenta.
PHASE_WHEEL = ("#f04848", "#e8c830", "#50c850", "#38c8c8", "#5078f8", "#d050e0", "#f04848")
POINT_RADIUS = 1.2  # voxels: a reflection is a point
LEAST_CLEAR = 0.5  # of the reflections: the weaker half is not shown
MOST_POINTS = 4000  # nor more than these, or all hues together are grey
SOLID_SHARE = 0.04  # of those that are shown: the strongest are solid
MOST_CLEAR_OF_BAND = 0.9
NO_PHASE = ("#38406c", "#f4f6ff")  # from the weakest to the strongest


def spectral_scene(subject: Subject | None) -> Scene:
    """Glowing gas: colour tells the axis of the spectrum, blue what approaches and red what recedes."""
    placed = subject if subject is not None and subject.kind is Kind.SPECTRAL_CUBE else None
    recedes = placed is None or placed.recedes
    hues = APPROACHING_TO_RECEDING if recedes else APPROACHING_TO_RECEDING[::-1]
    return Scene(
        tables=Tables(emit=colours(*zip(PLACES, hues, strict=True)), refl=DARK, opac=_glow(subject)),
        cross_bar=CrossBar(emit=placed.depth if placed else Field.GRID_K),
        shading=GLOWING,
    )


def _glow(subject: Subject | None) -> ScalarTable:
    """Clear up to the noise, then ever more opaque up to what only a hundredth of the signal exceeds."""
    if subject is not None and subject.kind is Kind.SPECTRAL_CUBE:
        values, at = subject.values, subject.histogram.place
        clear = CLEAR_NOISE * values.noise
        if values.noise > 0 and values.share_above(clear) >= LEAST_SIGNAL:
            bright = max(values.percentile(1 - BRIGHTEST * values.share_above(clear)), clear)
            start, end = at(clear), at(bright)
            return opacities((start, 0.0), (start + (end - start) / 4, 0.05), (end, 0.3))
    marks = landmarks(subject.histogram if subject else None)
    return scalars((marks.background, 0.0), (marks.object, 0.04), (marks.core, 0.5))


def structure_factors_scene(subject: Subject | None) -> Scene:
    """Points, the more opaque the greater the amplitude, coloured by phase if the volume has it."""
    if subject is not None and subject.kind is Kind.STRUCTURE_FACTORS and subject.bands:
        emit, opacity, bar = _by_bands(subject)
    else:
        opacity = _by_amplitude(subject)
        with_phases = subject is None or subject.has_phases
        bar = CrossBar(emit=Field.STRENGTH if with_phases else Field.DENSITY)
        emit = phase_colours() if with_phases else colours((0.0, NO_PHASE[0]), (1.0, NO_PHASE[1]))
    return Scene(
        tables=Tables(emit=emit, refl=DARK, opac=opacity),
        cross_bar=bar,
        shading=GLOWING,
        reconstruction=Reconstruction(radius=POINT_RADIUS),
    )


def phase_colours() -> ColourTable:
    """The wheel over a table whose positions are phases from 0 to 360 degrees."""
    return colours(*((n / (len(PHASE_WHEEL) - 1), colour) for n, colour in enumerate(PHASE_WHEEL)))


def _by_amplitude(subject: Subject | None) -> ScalarTable:
    """Amplitudes are there for reflections alone; what is no such list has a background, which stays clear."""
    if subject is None or subject.kind is not Kind.STRUCTURE_FACTORS:
        marks = landmarks(subject.histogram if subject else None)
        return scalars((marks.background, 0.0), (marks.object, 0.3), (marks.core, 1.0))
    values, at, clear = subject.values, subject.histogram.position, _clear_share(subject)
    faint, strong = at(values.percentile(clear)), at(values.percentile(1 - SOLID_SHARE * (1 - clear)))
    start, end = min(faint, (LAST - 1) / LAST), max(strong, faint + 1 / LAST)
    return scalars((start, 0.0), (start + (end - start) / 4, 0.8), (min(end, 1.0), 1.0))


def _clear_share(subject: Subject) -> float:
    return max(LEAST_CLEAR, 1 - MOST_POINTS / max(subject.values.voxels, 1))


def _first_level(subject: Subject) -> float:
    """From which share of their bands on the amplitudes are shown."""
    levels = Counter[float]()
    for band in subject.bands:
        start, end = class_bytes(subject, band)
        for byte in range(start, end + 1):
            levels[(byte - start) / max(end - start, 1)] += subject.histogram.counts[byte]
    seen, wanted = 0, _clear_share(subject) * levels.total()
    for level, count in sorted(levels.items()):
        seen += count
        if seen >= wanted:
            return min(level, MOST_CLEAR_OF_BAND)
    return 0.0


def _by_bands(subject: Subject) -> tuple[ColourTable, ScalarTable, CrossBar]:
    """Each band is a sector of phase, its colour the one in the sector's middle; amplitudes rise within it."""
    wheel = phase_colours().entries()
    first = _first_level(subject)
    emit: list[tuple[float, Colour]] = []
    opacity: list[tuple[float, float]] = []
    for n, band in enumerate(subject.bands):
        start, end = class_bytes(subject, band)
        hue = wheel[round((n + 0.5) / len(subject.bands) * LAST)]
        emit += [(start / LAST, hue), (end / LAST, hue)]
        rise = (end - start) / LAST
        shown = (first, first + (1 - first) / 4, 1.0)
        opacity += [(start / LAST, 0.0)]
        opacity += [(start / LAST + place * rise, value) for place, value in zip(shown, (0.0, 0.8, 1.0), strict=True)]
    return ColourTable(points=tuple(emit)), scalars(*opacity), CrossBar()
