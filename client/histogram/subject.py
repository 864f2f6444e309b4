"""What a scene is made for: a volume's kind, its classes and its values, under one window of densities."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from volsplat.client.histogram.density_histogram import (
    AIR_HU,
    TISSUE_HU,
    CtScale,
    DensityHistogram,
    ct_scale,
    density_histogram,
    recognised_ct,
)
from volsplat.client.histogram.value_counts import ValueCounts
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.shading_tables import Field
from volsplat.protocol.description.volume import HOUNSFIELD, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.upright import Up, upright
from volsplat.protocol.rules.index_rules import Survey

FACES = ("left", "front", "bottom")  # the views along the upright axes x, y and z
FRONT, OBLIQUE = "front", "oblique"
GRID_FIELDS = (Field.GRID_I, Field.GRID_J, Field.GRID_K)
LEAST_GAP = 0.001  # of the voxels: fewer without a value are stray ones, at which nothing ends
SLAB = 0.25  # of the next longer side: what is no thicker is a slab
FLAT = 0.45  # likewise: what is no thicker shows little of itself from its edge


@dataclass(frozen=True)
class Subject:
    """The histogram of density bytes, and what else is known; by itself, that nothing is."""

    histogram: DensityHistogram
    kind: Kind = Kind.UNKNOWN  # as the reader states it
    bands: tuple[Band, ...] = ()
    has_phases: bool = False  # in the packets' second byte
    whole_numbers: bool = False
    in_hounsfield: bool = False
    depth: Field = Field.GRID_K  # the grid's axis that leads away from the viewer in front
    recedes: bool = True  # along this axis
    first_view: str = FRONT  # one of FACES, or OBLIQUE: from the side and above
    single_slice: bool = False
    has_gaps: bool = False  # of voxels without a value, at which what is seen may end
    fine: ValueCounts | None = None  # the values before they became bytes
    usual: "Subject | None" = None  # the same under the automatic window, if this one is another

    @cached_property
    def values(self) -> ValueCounts:
        """All values; where only bytes are known, as those have them."""
        return self.fine or ValueCounts(*self.histogram.window, self.histogram.counts)

    @cached_property
    def ct(self) -> CtScale | None:
        """Hounsfield units on a table: as the file states them, or as a CT is recognised where it states nothing."""
        if self.kind is Kind.CT and self.in_hounsfield:
            low, high = self.histogram.window
            return CtScale((AIR_HU - low) / (high - low), (TISSUE_HU - low) / (high - low))
        if self.kind not in (Kind.CT, Kind.UNKNOWN):
            return None
        return self._moved(self.usual, self.usual.ct) if self.usual else recognised_ct(self.histogram)

    @cached_property
    def ct_or_peaks(self) -> CtScale:
        """The same, and of what is not recognised as a CT by its two greatest peaks.

        They are those under the automatic window: another one may leave nothing of them.
        """
        if self.ct:
            return self.ct
        return (self.usual and self._moved(self.usual, self.usual.ct_or_peaks)) or ct_scale(self.histogram)

    def _moved(self, usual: "Subject", scale: CtScale | None) -> CtScale | None:
        return scale and scale.moved(usual.histogram.window, self.histogram.window)


def histogram_of(subject: Subject | None) -> DensityHistogram | None:
    return subject.histogram if subject else None


def subject_of(
    description: VolumeDescription,
    survey: Survey,
    density_counts: list[int],
    window: tuple[float, float],
    up: Up | Literal["auto"] = "auto",
    usual: Subject | None = None,
) -> Subject:
    """What is known of a volume, under a window; `up` is the physical axis that is, "auto" if nothing tells it.

    `usual` is what this gives under the automatic window, if this is another. `density_counts` split
    the values' range in survey.ranges. Raises BadInput for a window without a scale.
    """
    steps = [matrices.column(description.geometry.index_to_physical, axis) for axis in range(3)]
    ranges = survey.ranges
    away = [matrices.normalised(step)[1] for step in steps]
    depth = max(range(3), key=lambda axis: abs(away[axis]))
    return Subject(
        histogram=density_histogram(survey, density_counts, window),
        kind=description.kind,
        bands=description.bands,
        has_phases=description.second_scalar is not None,
        whole_numbers="int" in description.scalar_type,
        in_hounsfield=description.value_unit == HOUNSFIELD,
        depth=GRID_FIELDS[depth],
        recedes=away[depth] > 0,
        first_view=_first_view(description, up),
        has_gaps=survey.no_data > LEAST_GAP * survey.voxels,
        single_slice=sorted(description.geometry.dims)[:2].count(1) == 1,
        fine=ValueCounts(ranges.low, ranges.high, density_counts) if survey.low <= survey.high else None,
        usual=usual,
    )


def _first_view(description: VolumeDescription, up: Up | Literal["auto"]) -> str:
    """The front, from which bodies, molecules and the sky are seen, if it shows enough.

    A slab is seen from its face, as radiologists and image viewers see it, and so is any flat stack that does not
    stand. Where a file tells which way is up, what lies flat is seen from the side and above, and so is a seismic
    survey: inline, crossline and time slice at once.
    """
    steps = [matrices.column(description.geometry.index_to_physical, axis) for axis in range(3)]
    extents = [
        (count - 1) * matrices.length(step) for count, step in zip(description.geometry.dims, steps, strict=True)
    ]
    flat, *wide = sorted(range(3), key=extents.__getitem__)
    if extents[wide[0]] == 0.0:  # a single row
        return FRONT
    if description.kind is Kind.SEISMIC and extents[flat] > 0.0:
        return OBLIQUE
    thickness = extents[flat] / extents[wide[0]]
    normal = matrices.applied(upright(up), matrices.cross(steps[wide[0]], steps[wide[1]]))
    face = FACES[max(range(3), key=lambda axis: abs(normal[axis]))]
    if thickness <= SLAB or (thickness <= FLAT and up == "auto"):
        return face
    lies = description.up is not None and not description.anatomical and description.kind is not Kind.SPECTRAL_CUBE
    return OBLIQUE if thickness <= FLAT and lies and face != FRONT else FRONT
