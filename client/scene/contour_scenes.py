"""Scenes that show a surface where a value is reached: densities at one sign, differences and waves at both.

The levels are those that the fields are used to: crystallographers contour a map in sigma, its deviation, about its
mean (Coot starts at 1.5), a difference at 3 sigma, green above and red below; microscopists about 3; chemists an
orbital where a share of its probability is enclosed. Sigma is that of all voxels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from volsplat.client.histogram.density_histogram import LAST
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.table_makers import GLOW, KEY_LIGHT, REFLECTION, colours, dimmed, scalars
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import Tables

SURFACE = 0.9  # opacity behind a contour
# Sigma by sigma less where next to nothing is as strong, as in a box that is cut close around a particle.
CRYSTAL_SIGMAS: Sequence[float] = (1.5, 1.0, 0.5)
EM_SIGMAS: Sequence[float] = (3.0, 2.5, 2.0, 1.5, 1.0, 0.5)
DIFFERENCE_SIGMAS: Sequence[float] = (3.0, 2.5, 2.0)
LEAST_CONTOURED = 0.01  # of the voxels
LEAST_DIFFERENT = 0.0005
SIGNIFICANT = 3.1  # of a statistic in deviations: one in a thousand by chance
MOST_SIGNIFICANT = 0.2  # of the voxels; else it is no statistic in deviations
STRONGEST = 0.05  # of the voxels that are shown then
ENCLOSED_WAVE = 0.8  # of the probability
ENCLOSED_ELECTRONS = 0.95
ATOM_ELECTRONS = 0.8  # of atom density: a carbon's at its covalent radius

DENSITY_BLUE = ("#3f66b8", "#7f9fe0", "#dfe8fa")
PARTICLE = ("#b07858", "#dca884", "#f4ead8")
GREEN, RED = ("#2fae48", "#70e084"), ("#d83c34", "#f88078")
WARM, COLD = ("#d08850", "#f4d8b0"), ("#4a86d8", "#b8d4f4")
HOT, COOL = ("#e04820", "#f8d848"), ("#2858d8", "#78c8f0")


@dataclass(frozen=True)
class Level:
    """A contour in the data's units, and how a person is told of it."""

    value: float
    told: str


def contour_level(subject: Subject) -> Level | None:
    """Where the subject's default scene has its contour; None for kinds that have none."""
    values = subject.values
    match subject.kind:
        case Kind.CRYSTAL_MAP:
            return _sigma_level(subject, CRYSTAL_SIGMAS)
        case Kind.EM_MAP | Kind.PATTERSON:
            return _sigma_level(subject, EM_SIGMAS)
        case Kind.DIFFERENCE_MAP:
            sigmas = (n for n in DIFFERENCE_SIGMAS if _both_shares(subject, n * values.deviation) >= LEAST_DIFFERENT)
            n = next(sigmas, DIFFERENCE_SIGMAS[-1])
            return Level(n * values.deviation, f"{n:g} sigma on either side of 0")
        case Kind.WAVE_FUNCTION:
            level = values.enclosing(ENCLOSED_WAVE, power=2)
            return Level(level, f"{ENCLOSED_WAVE:.0%} of the probability enclosed")
        case Kind.ELECTRON_DENSITY:
            level = values.enclosing(ENCLOSED_ELECTRONS, power=1)
            return Level(level, f"{ENCLOSED_ELECTRONS:.0%} of the electrons enclosed")
        case Kind.ATOM_DENSITY:
            return Level(ATOM_ELECTRONS, "a carbon's density at its covalent radius")
        case Kind.STATISTIC_MAP:
            return _statistic_level(subject)
    return None


def _sigma_level(subject: Subject, sigmas: Sequence[float]) -> Level:
    values = subject.values
    enough = (n for n in sigmas if values.share_above(values.mean + n * values.deviation) >= LEAST_CONTOURED)
    n = next(enough, sigmas[-1])
    return Level(values.mean + n * values.deviation, f"{n:g} sigma above the mean")


def _statistic_level(subject: Subject) -> Level:
    if 0 < _both_shares(subject, SIGNIFICANT) <= MOST_SIGNIFICANT:
        return Level(SIGNIFICANT, "one in a thousand by chance, if it counts deviations")
    values = subject.values
    low, high = 0.0, max(abs(values.low), abs(values.high))
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _both_shares(subject, middle) > STRONGEST else (low, middle)
    return Level(high, f"the strongest {STRONGEST:.0%} of the voxels")


def _both_shares(subject: Subject, level: float) -> float:
    return subject.values.share_above(level) + subject.values.share_below(-level)


def density_scene(subject: Subject) -> Scene | None:
    """A closed surface at the contour; None if nothing lies above it."""
    level = contour_level(subject)
    if level is None or not subject.values.share_above(level.value) > 0:
        return None
    at = subject.histogram.position
    tint = DENSITY_BLUE if subject.kind is Kind.CRYSTAL_MAP else PARTICLE
    strongest = subject.values.percentile(1 - 0.01 * subject.values.share_above(level.value))
    start, end = at(level.value), max(at(strongest), at(level.value))
    table = colours((start, tint[0]), (start + (end - start) / 3, tint[1]), (end, tint[2]))
    return Scene(
        tables=Tables(
            emit=dimmed(table, GLOW),
            refl=dimmed(table, REFLECTION),
            opac=scalars(*_above(start)),
        ),
        shading=Shading(modulation=False),
        light=KEY_LIGHT,
    )


def both_signs_scene(subject: Subject) -> Scene | None:
    """Surfaces at the contour of either sign, each in its colours; None if nothing lies beyond them."""
    level = contour_level(subject)
    if level is None or not level.value > 0 or not _both_shares(subject, level.value) > 0:
        return None
    at, values = subject.histogram.position, subject.values
    above, below = {
        Kind.DIFFERENCE_MAP: (GREEN, RED),
        Kind.STATISTIC_MAP: (HOT, COOL),
    }.get(subject.kind, (WARM, COLD))
    negative, zero, positive = at(-level.value), at(0.0), at(level.value)
    table = colours(
        (min(at(values.low), negative), below[1]),
        (negative, below[0]),
        (positive, above[0]),
        (max(at(values.high), positive), above[1]),
    )
    opacity: list[tuple[float, float]] = []
    # Where the window begins or ends at zero or beyond it, the entry there is that of the background, too.
    if values.low < -level.value and zero > FIRST:
        opacity += _below(negative)
    if values.high > level.value and zero < LAST_BUT_ONE:
        opacity += _above(positive)
    return Scene(
        tables=Tables(emit=dimmed(table, GLOW), refl=dimmed(table, REFLECTION), opac=scalars(*opacity or [(0.0, 0.0)])),
        shading=Shading(modulation=False, two_sided=True),
        light=KEY_LIGHT,
    )


def _above(position: float) -> list[tuple[float, float]]:
    """Nothing up to the contour, and a surface from the next byte on."""
    start = min(position, LAST_BUT_ONE)
    return [(start, 0.0), (min(start + EDGE, 1.0), SURFACE)]


def _below(position: float) -> list[tuple[float, float]]:
    start = max(position, FIRST)
    return [(max(start - EDGE, 0.0), SURFACE), (start, 0.0)]


FIRST, LAST_BUT_ONE = 1 / LAST, (LAST - 1) / LAST  # positions: a contour beyond these would leave nothing of its side
EDGE = 2.0 / LAST  # from clear to SURFACE: two bytes, so that the surface is no staircase
