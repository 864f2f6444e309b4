"""What is known of a volume so far: described by one server, surveyed and counted by all, a part by each."""

from array import array

from volsplat.client.volume.survey_checks import check_counts, check_extremes
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.messages.volume_messages import (
    HISTOGRAM_BYTES,
    CountHistograms,
    HistogramsCounted,
    VolumeDescribed,
)
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey
from volsplat.protocol.text.errors import RemoteProtocolError

HISTOGRAMS_BYTES = HISTOGRAM_BINS * HISTOGRAM_BYTES


class VolumeSurvey:
    """Of a volume that was prepared all is known at once."""

    def __init__(self, described: VolumeDescribed, payload: memoryview) -> None:
        self.description, self.identity = described.description, described.identity
        self.prepared = described.prepared[0] if described.prepared else None
        self._survey: Survey | None = None
        self._extremes: BlockExtremes | None = None
        self.begin()
        if self.prepared is not None:
            self._survey = self.prepared.survey
            self._add(payload)

    def begin(self) -> None:
        """Survey and count from the start."""
        self._survey, self._extremes = None, None
        self._density_counts = self._strength_counts = [0] * HISTOGRAM_BINS

    def surveyed(self, survey: Survey) -> None:
        """Take one server's part."""
        self._survey = survey if self._survey is None else self._survey.joined(survey)

    def count_request(self, assignment: int) -> CountHistograms:
        """What to ask once every part is surveyed."""
        assert self._survey is not None
        low, high = self._survey.low, self._survey.high
        return CountHistograms(assignment=assignment, low=low, high=high, max_gradient=self._survey.max_gradient)

    def counted(self, message: HistogramsCounted, payload: memoryview, voxels: int) -> None:
        """Take one server's part, of so many voxels. Raises RemoteProtocolError if it cannot be that."""
        if message.bins != HISTOGRAM_BINS:
            raise RemoteProtocolError(f"it counted {message.bins} bins, but {HISTOGRAM_BINS} were asked for")
        check_counts(payload[:HISTOGRAMS_BYTES], voxels)
        check_extremes(payload[HISTOGRAMS_BYTES:], self.description.geometry.dims)
        self._add(payload)

    def volume(self) -> SurveyedVolume:
        """All that is known, once every part is counted."""
        assert self._survey is not None and self._extremes is not None
        counts = self._density_counts, self._strength_counts
        return SurveyedVolume(self.description, self._survey, *counts, self._extremes, self.prepared)

    def _add(self, payload: memoryview) -> None:
        counts = array("q", payload[:HISTOGRAMS_BYTES].tobytes())
        self._density_counts = list(map(int.__add__, self._density_counts, counts[:HISTOGRAM_BINS]))
        self._strength_counts = list(map(int.__add__, self._strength_counts, counts[HISTOGRAM_BINS:]))
        extremes = BlockExtremes.of_bytes(payload[HISTOGRAMS_BYTES:])
        self._extremes = extremes if self._extremes is None else self._extremes.joined(extremes)
