"""The first pass: what a session's servers find out of their sub-cubes, block by block of any volume."""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.prepare.ahead import ahead
from volsplat.mapshade_server.prepare.progress import Progress
from volsplat.mapshade_server.prepare.scalars import Scalars
from volsplat.mapshade_server.sub_cube import Histograms, SubCube
from volsplat.protocol import index_rules
from volsplat.protocol.index_rules import HISTOGRAM_BINS, Quantisation, Survey
from volsplat.protocol.volume import HALO, Box, Geometry, VolumeDescription

Counts = NDArray[np.int64]


class Surveyed(NamedTuple):
    survey: Survey
    density_counts: Counts
    strength_counts: Counts

    def quantisation(
        self,
        description: VolumeDescription,
        window: tuple[float, float] | None,
        directions: Literal["octahedral", "paper"],
    ) -> Quantisation:
        """By index_rules, as a session's; `window` takes the place of the one that the data chooses."""
        counts, second = self.density_counts.tolist(), description.second_scalar
        chosen = window or index_rules.density_window(self.survey, counts, description.scalar_type)
        if second is not None:
            return Quantisation(chosen, index_rules.second_scalar_scale(second), directions, strength_low=second[0])
        return Quantisation(chosen, index_rules.strength_scale(self.survey, self.strength_counts.tolist()), directions)


def survey_volume(
    source: Scalars, geometry: Geometry, blocks: list[Box], threads: int, item_bytes: int, progress: Progress
) -> Surveyed:
    """Reads the volume twice, `threads` blocks at a time. Raises BadInput."""

    def held(block: Box) -> SubCube:
        sub_cube = SubCube(geometry, block, source.second_range)
        sub_cube.hold(*source.read(block, block.grown(HALO, geometry.dims)))
        return sub_cube

    progress.begin("surveying", geometry.box.voxels * item_bytes)
    survey = Survey(low=math.inf, high=-math.inf, max_gradient=0.0, voxels=0, no_data=0)
    for part in ahead(lambda block: held(block).survey(), blocks, threads):
        survey = survey.joined(part)
        progress.advance(part.voxels * item_bytes)

    def histograms(block: Box) -> Histograms:
        return held(block).histograms(survey.low, survey.high, survey.max_gradient)

    progress.begin("counting", geometry.box.voxels * item_bytes)
    density, strength = np.zeros(HISTOGRAM_BINS, np.int64), np.zeros(HISTOGRAM_BINS, np.int64)
    for block, (more_density, more_strength) in zip(blocks, ahead(histograms, blocks, threads), strict=True):
        density += np.asarray(more_density)
        strength += np.asarray(more_strength)
        progress.advance(block.voxels * item_bytes)
    return Surveyed(survey, density, strength)
