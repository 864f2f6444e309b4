"""Boxes of a volume that a server looks at and does not hold."""

from collections.abc import Iterator
from functools import reduce

from volsplat.mapshade_server.held.sheet_reader import SheetReader
from volsplat.mapshade_server.held.sub_cube import Histograms, SubCube
from volsplat.protocol.description.volume import Box
from volsplat.protocol.rules.index_rules import Survey


class PassedBox:
    """A box of a volume that is surveyed as a SubCube is, but not held: its file is read anew for each question."""

    def __init__(self, reader: SheetReader, box: Box) -> None:
        self.box = box
        self._reader = reader

    def survey(self) -> Survey:
        """Raises BadInput, as SubCube does."""
        return reduce(Survey.joined, (part.survey() for part in self._parts()))

    def histograms(self, low: float, high: float, max_gradient: float) -> Histograms:
        return reduce(Histograms.joined, (part.histograms(low, high, max_gradient) for part in self._parts()))

    def _parts(self) -> Iterator[SubCube]:
        return (sheets.sub_cube for sheets in self._reader.sheets(self.box))
