"""The first passes: what a session's servers find out of their sub-cubes, a few sheets of any volume at a time."""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.held.sheet_reader import SheetReader, Sheets
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.prepare.progress import Progress
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.rules import index_rules
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Quantisation, Survey
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT
from volsplat.protocol.text.errors import BadInput

Counts = NDArray[np.int64]
Found = TypeVar("Found")


@dataclass(frozen=True)
class Surveyed:
    survey: Survey
    density_counts: Counts
    strength_counts: Counts
    commonest: NDArray[np.generic] | None  # value of the voxels that were looked at, one alone; None: not a number
    extremes: BlockExtremes

    def quantisation(
        self,
        description: VolumeDescription,
        window: tuple[float, float] | None,
        directions: Literal["octahedral", "paper"],
    ) -> Quantisation:
        """By index_rules, as a session's; `window` takes the place of the one that the data chooses."""
        counts, second = self.density_counts.tolist(), description.second_scalar
        chosen = window or index_rules.density_window(self.survey, counts, description.scalar_type, description.kind)
        if second is not None:
            scale = index_rules.second_scalar_scale(second)
            return Quantisation(chosen, scale, directions, strength_low=second[0], has_strength=False)
        return Quantisation(chosen, index_rules.strength_scale(self.survey, self.strength_counts.tolist()), directions)

    def background(self, description: VolumeDescription, quantisation: Quantisation) -> int:
        """The packet of voxels among others of the commonest value, which most likely fills most bricks."""
        if self.commonest is None or description.second_scalar is not None:
            return 1 << NO_DATA_BIT
        alone = Geometry((1, 1, 1), description.geometry.index_to_physical)
        sub_cube = SubCube(alone, alone.box)
        sub_cube.hold(self.commonest.reshape(1, 1, 1))
        sub_cube.pack(quantisation)
        return int(np.asarray(memoryview(sub_cube.packets))[0, 0, 0])


class _Looked(NamedTuple):
    """What is found out of some sheets at first."""

    survey: Survey
    sampled: NDArray[np.generic]


class _Counted(NamedTuple):
    """What is found out of some sheets once the extremes of all are known."""

    voxels: int
    density: Counts
    strength: Counts
    extremes: BlockExtremes


class Surveyor(Protocol):
    """Who goes through all sheets."""

    def of_sheets(self, find: Callable[[Sheets], Found], reader: SheetReader) -> Iterator[Found]:
        """What is found out of those that are read at once, in any order."""
        ...


def survey_volume(
    reader: SheetReader, told: VolumeDescription, brick: int, surveyor: Surveyor, item_bytes: int, progress: Progress
) -> Surveyed:
    """Has the volume read twice, or more often if a few values lie far from all others.

    Raises BadInput, also if no voxel has a value.
    """
    whole = reader.geometry.box
    progress.begin("surveying", whole.voxels * item_bytes)
    survey = Survey(low=math.inf, high=-math.inf, max_gradient=0.0, voxels=0, no_data=0)
    sampled: list[NDArray[np.generic]] = []
    for looked in surveyor.of_sheets(partial(_looked, brick), reader):
        survey = survey.joined(looked.survey)
        sampled.append(looked.sampled)
        progress.advance(looked.survey.voxels * item_bytes)
    if survey.low > survey.high:
        raise BadInput(f"{told.name}: no voxel has a value, all are NaN or infinite; export the volume again")

    commonest = _commonest(np.concatenate(sampled))
    while True:
        surveyed = _counted_all(survey, reader, surveyor, item_bytes, progress, commonest)
        counts = surveyed.density_counts.tolist()
        narrower = index_rules.narrowed(survey, counts, surveyed.extremes, told.scalar_type, told.kind)
        if narrower is None:
            return surveyed
        survey = narrower


def _counted_all(
    survey: Survey,
    reader: SheetReader,
    surveyor: Surveyor,
    item_bytes: int,
    progress: Progress,
    commonest: NDArray[np.generic] | None,
) -> Surveyed:
    progress.begin("counting", reader.geometry.box.voxels * item_bytes)
    density, strength = np.zeros(HISTOGRAM_BINS, np.int64), np.zeros(HISTOGRAM_BINS, np.int64)
    extremes = BlockExtremes.nothing(reader.geometry.dims)
    for counted in surveyor.of_sheets(partial(_counted, survey), reader):
        density += counted.density
        strength += counted.strength
        extremes = extremes.joined(counted.extremes)
        progress.advance(counted.voxels * item_bytes)
    return Surveyed(survey, density, strength, commonest, extremes)


def _looked(brick: int, sheets: Sheets) -> _Looked:
    corners = tuple(slice(-low % brick, None, brick) for low in sheets.box.low)[::-1]
    return _Looked(sheets.sub_cube.survey(), sheets.values[corners].flatten())  # a copy: a view would keep them all


def _counted(survey: Survey, sheets: Sheets) -> _Counted:
    ranges = survey.ranges
    found = sheets.sub_cube.histograms(ranges.low, ranges.high, ranges.max_gradient)
    return _Counted(sheets.box.voxels, np.asarray(found.density), np.asarray(found.strength), found.extremes)


def _commonest(values: NDArray[np.generic]) -> NDArray[np.generic] | None:
    """The value that most have, the least of several; None if most have none."""
    finite = values[np.isfinite(values)]
    counts = Counter(finite.tolist())
    most = max(counts.values(), default=0)
    if most < len(values) - len(finite):
        return None
    return np.array(min(value for value, count in counts.items() if count == most), values.dtype)
