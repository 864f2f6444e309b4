"""Scenes of magnetic resonance, whose values have no unit: placed by shares of the voxels that are no background."""

from dataclasses import dataclass

from volsplat.client.histogram.density_histogram import LAST, otsu_byte
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.table_makers import KEY_LIGHT, colours, scalars
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import Tables

VESSELS = 0.985  # of all voxels are less bright than flowing blood
LEAST_STEP = 1 / LAST


@dataclass(frozen=True)
class _Tissue:
    """Positions of shares of the voxels above the valley between background and tissue."""

    subject: Subject | None

    def start(self) -> float:
        """The valley."""
        if self.subject is None or not self.subject.histogram.voxels:
            return 0.2
        return min(otsu_byte(self.subject.histogram.smoothed()), LAST - 4) / LAST

    def at(self, share: float) -> float:
        """Where as much of the tissue lies below."""
        start = self.start()
        if self.subject is None or not self.subject.histogram.voxels:
            return start + (1 - start) * share
        histogram = self.subject.histogram
        below = 1 - histogram.share_above(round(start * LAST))
        return max(histogram.byte_at_share(below + (1 - below) * share) / LAST, start)


def mr_t1_scene(subject: Subject | None) -> Scene:
    tissue = _Tissue(subject)
    start, middle, bright = _rising(tissue.start() * 0.75, tissue.at(0.5), tissue.at(0.98))
    return Scene(
        tables=Tables(
            emit=colours((start, "#2a1a14"), (middle, "#3c2c22"), (bright, "#5c5244")),
            refl=colours((start, "#8a5a48"), (middle, "#c09078"), (bright, "#f0e4cc")),
            opac=scalars((start, 0.0), (middle, 0.6), (bright, 0.9)),
        ),
        shading=Shading(modulation=False, specular_power=25.0),
        light=KEY_LIGHT,
    )


def mr_t2_scene(subject: Subject | None) -> Scene:
    tissue = _Tissue(subject)
    start, fluid, bright = _rising(tissue.start(), tissue.at(0.88), tissue.at(0.99))
    veil = (start + fluid) / 2
    return Scene(
        tables=Tables(
            emit=colours((start, "#2a1c16"), (veil, "#35241c"), (fluid, "#0c2450"), (bright, "#2050a0")),
            refl=colours((start, "#906454"), (veil, "#b08470"), (fluid, "#3a78c8"), (bright, "#90c4f4")),
            opac=scalars((start, 0.0), (veil, 0.025), (fluid, 0.025), (bright, 0.8)),
        ),
        shading=Shading(modulation=False, specular_power=25.0),
        light=KEY_LIGHT,
    )


def mr_angio_scene(subject: Subject | None) -> Scene:
    tissue = _Tissue(subject)
    known = subject is not None and subject.histogram.voxels
    vessels = subject.histogram.byte_at_share(VESSELS) / LAST if subject is not None and known else tissue.at(0.6)
    start, wall, core = _rising(vessels, vessels + (1 - vessels) * 0.25, 1.0)
    return Scene(
        tables=Tables(
            emit=colours((start, "#300806"), (wall, "#501408"), (core, "#803018")),
            refl=colours((start, "#8c1c14"), (wall, "#d84028"), (core, "#ffc088")),
            opac=scalars((start, 0.0), (wall, 0.7), (core, 0.95)),
        ),
        shading=Shading(modulation=False, specular_power=30.0),
        light=KEY_LIGHT,
    )


def _rising(first: float, second: float, third: float) -> tuple[float, float, float]:
    """These positions, at least a byte apart and none beyond the table's end."""
    first = min(first, 1 - 2 * LEAST_STEP)
    second = min(max(second, first + LEAST_STEP), 1 - LEAST_STEP)
    return first, second, min(max(third, second + LEAST_STEP), 1.0)
