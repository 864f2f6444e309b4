"""Boxes of a volume that a server looks at and does not hold."""

import numpy as np

from volsplat.mapshade_server.held.sheet_reader import SheetReader
from volsplat.mapshade_server.held.sub_cube import Histograms
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.volume import Box
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey


class PassedBox:
    """A box of a volume that is surveyed as a SubCube is, but not held: its file is read anew for each question."""

    def __init__(self, reader: SheetReader, box: Box) -> None:
        self.box = box
        self._reader = reader

    def survey(self) -> Survey:
        """Raises BadInput, as SubCube does."""
        parts = [sheets.sub_cube.survey() for sheets in self._reader.sheets(self.box)]
        survey = parts[0]
        for part in parts[1:]:
            survey = survey.joined(part)
        return survey

    def histograms(self, low: float, high: float, max_gradient: float) -> Histograms:
        density, strength = np.zeros(HISTOGRAM_BINS, np.int64), np.zeros(HISTOGRAM_BINS, np.int64)
        extremes = BlockExtremes.nothing(self._reader.geometry.dims)
        for sheets in self._reader.sheets(self.box):
            more = sheets.sub_cube.histograms(low, high, max_gradient)
            density += np.asarray(more.density)
            strength += np.asarray(more.strength)
            extremes = extremes.joined(more.extremes)
        return Histograms(density.data, strength.data, extremes)
