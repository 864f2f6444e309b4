"""The figures of a movie's frames, all of one size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from volsplat.client.figure.drawing import Drawing
from volsplat.client.figure.figure import Figure
from volsplat.client.figure.layout import figure_extent, laid_out
from volsplat.client.figure.painted import painted
from volsplat.client.figure.pointing_labels import Ways
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene

Pixels = NDArray[np.float32]


class FrameFigure:
    """Draws what is about and over each frame. `of_several`: the volume is the first of several, on one grid."""

    def __init__(
        self, figure: Figure, scenes: Sequence[Scene], volume: SurveyedVolume, of_several: bool = False
    ) -> None:
        self.figure = figure
        self._volume = volume
        self._of_several = of_several
        self._ways: Ways = {}
        sizes = {figure_extent(figure, scene, volume, of_several) for scene in scenes}
        self.extent = (max(width for width, _ in sizes), max(height for _, height in sizes))

    def pixels(self, picture: Pixels, scene: Scene) -> Pixels:
        """The next frame with all that the figure shows, as a plain image is."""
        return painted(self.drawing(picture, scene))

    def drawing(self, picture: Pixels, scene: Scene) -> Drawing:
        """Of the next frame: labels stay to the side of their voxels as long as they can."""
        return laid_out(picture, self.figure, scene, self._volume, self.extent[1], self._of_several, self._ways)
