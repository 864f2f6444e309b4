"""The volume as the client knows it; scenes and quantisation follow from it."""

from dataclasses import dataclass
from functools import cached_property

from volsplat.client.default_scene import default_scene
from volsplat.client.density_histogram import DensityHistogram, density_histogram
from volsplat.protocol import index_rules
from volsplat.protocol.index_rules import Quantisation, Survey
from volsplat.protocol.scene import Quantise, Scene
from volsplat.protocol.volume import VolumeDescription


@dataclass(frozen=True)
class SurveyedVolume:
    """What is known of a volume once every server has read its sub-cube."""

    description: VolumeDescription
    survey: Survey
    density_counts: list[int]
    strength_counts: list[int]

    @cached_property
    def automatic_window(self) -> tuple[float, float]:
        """The density window that the data chooses, in its own units."""
        return index_rules.density_window(self.survey, self.density_counts, self.description.scalar_type)

    @cached_property
    def strength_scale(self) -> float:
        """Bytes per unit of |gradient|."""
        return index_rules.strength_scale(self.survey, self.strength_counts)

    def quantisation(self, quantise: Quantise) -> Quantisation:
        """The rules by which the whole volume becomes 8 bits."""
        return Quantisation(
            window=self.automatic_window if quantise.window == "auto" else quantise.window,
            strength_scale=self.strength_scale,
            directions=quantise.directions,
        )

    def density_histogram(self) -> DensityHistogram:
        """The histogram of density bytes under the window that the data chooses."""
        return density_histogram(self.survey, self.density_counts, self.automatic_window)

    def default_scene(self) -> Scene:
        """A scene chosen from the data, so that the first picture is never empty."""
        return default_scene(self.description, self.survey, self.density_counts, self.automatic_window)
