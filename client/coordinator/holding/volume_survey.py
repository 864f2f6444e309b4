"""What is known of a volume so far: described by one server, surveyed and counted by all, a part by each."""

import math

import numpy as np

from volsplat.client.volume.survey_checks import check_counts, check_extremes
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.block_extremes import BlockExtremes, block_dims
from volsplat.protocol.messages.volume_messages import (
    HISTOGRAM_BYTES,
    CountHistograms,
    HistogramsCounted,
    VolumeDescribed,
)
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey, narrowed
from volsplat.protocol.text.errors import RemoteProtocolError

HISTOGRAMS_BYTES = HISTOGRAM_BINS * HISTOGRAM_BYTES


class VolumeSurvey:
    """Of a volume that was prepared all is known at once."""

    def __init__(self, described: VolumeDescribed, payload: memoryview) -> None:
        self.description, self.identity = described.description, described.identity
        self.prepared = described.prepared
        self._survey: Survey | None = None
        self.begin()
        if self.prepared is not None:
            self._survey = self.prepared.survey
            self._add(payload)

    def begin(self) -> None:
        """Survey and count from the start."""
        self._survey = None
        self._counts = np.zeros((2, HISTOGRAM_BINS), np.int64)  # of densities, of strengths
        blocks = math.prod(block_dims(self.description.geometry.dims))
        self._extremes = np.repeat([[math.inf], [-math.inf]], blocks, axis=1)  # as BlockExtremes.nothing

    def surveyed(self, survey: Survey) -> None:
        """Take one server's part."""
        self._survey = survey if self._survey is None else self._survey.joined(survey)

    def count_request(self, assignment: int) -> CountHistograms:
        """What to ask once every part is surveyed, or counted too coarsely."""
        assert self._survey is not None
        ranges = self._survey.ranges
        return CountHistograms(assignment, low=ranges.low, high=ranges.high, max_gradient=ranges.max_gradient)

    def counted(self, message: HistogramsCounted, payload: memoryview, voxels: int) -> None:
        """Take one server's part, of so many voxels. Raises RemoteProtocolError if it cannot be that."""
        if message.bins != HISTOGRAM_BINS:
            raise RemoteProtocolError(f"it counted {message.bins} bins, but {HISTOGRAM_BINS} were asked for")
        check_counts(payload[:HISTOGRAMS_BYTES], voxels)
        check_extremes(payload[HISTOGRAMS_BYTES:], self.description.geometry.dims)
        self._add(payload)

    def volume(self) -> SurveyedVolume | None:
        """All that is known, once every part is counted. None: all is to be counted once more, over narrower ranges."""
        assert self._survey is not None
        density_counts, strength_counts = self._counts.tolist()
        extremes, told = BlockExtremes(*self._extremes.tolist()), self.description
        if self.prepared is None:
            narrower = narrowed(self._survey, density_counts, extremes, told.scalar_type, told.kind)
            if narrower is not None:
                self._survey = narrower
                self._counts[:] = 0
                return None
        return SurveyedVolume(self.description, self._survey, density_counts, strength_counts, extremes, self.prepared)

    def _add(self, payload: memoryview) -> None:
        self._counts += np.frombuffer(payload[:HISTOGRAMS_BYTES], np.int64).reshape(2, -1)
        least, greatest = np.frombuffer(payload[HISTOGRAMS_BYTES:], np.float64).reshape(2, -1)
        self._extremes = np.array([np.minimum(self._extremes[0], least), np.maximum(self._extremes[1], greatest)])
