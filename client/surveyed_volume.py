"""The volume as the client knows it; scenes and quantisation follow from it."""

from dataclasses import dataclass
from functools import cached_property

from volsplat.client.default_scene import default_scene
from volsplat.client.density_histogram import DensityHistogram, density_histogram
from volsplat.client.subject import Subject, subject_of
from volsplat.protocol import index_rules
from volsplat.protocol.errors import BadInput
from volsplat.protocol.index_rules import Quantisation, Survey
from volsplat.protocol.levels import Prepared
from volsplat.protocol.scene import Quantise, Scene
from volsplat.protocol.volume import VolumeDescription


@dataclass(frozen=True)
class SurveyedVolume:
    """What is known of a volume once every server has read its sub-cube."""

    description: VolumeDescription
    survey: Survey
    density_counts: list[int]  # over survey.low..survey.high
    strength_counts: list[int]  # over strength_range
    prepared: Prepared | None = None  # where its packets were made before

    @cached_property
    def automatic_window(self) -> tuple[float, float]:
        """The density window that the data chooses, in its own units; or with which it was prepared."""
        if self.prepared is not None:
            return self.prepared.quantisation.window
        return index_rules.density_window(self.survey, self.density_counts, self.description.scalar_type)

    @property
    def strength_range(self) -> tuple[float, float]:
        """What the packets' second byte may hold: |gradient|, or a second scalar."""
        return self.description.second_scalar or (0.0, self.survey.max_gradient)

    @cached_property
    def strength_scale(self) -> float:
        """Bytes per unit of |gradient|, or of the second scalar."""
        if self.prepared is not None:
            return self.prepared.quantisation.strength_scale
        if self.description.second_scalar is not None:
            return index_rules.second_scalar_scale(self.description.second_scalar)
        return index_rules.strength_scale(self.survey, self.strength_counts)

    def quantisation(self, quantise: Quantise) -> Quantisation:
        """The rules by which the whole volume becomes 8 bits."""
        return Quantisation(
            window=self.automatic_window if quantise.window == "auto" else quantise.window,
            strength_scale=self.strength_scale,
            directions=quantise.directions,
            strength_low=self.strength_range[0],
        )

    def density_histogram(self) -> DensityHistogram:
        """The histogram of density bytes under the window that the data chooses."""
        return density_histogram(self.survey, self.density_counts, self.automatic_window)

    def check_has_values(self) -> None:
        """Raises BadInput where there is nothing to draw."""
        if self.survey.low > self.survey.high:
            name = self.description.name
            raise BadInput(f"{name}: no voxel has a value, all are NaN or infinite; export the volume again")

    def notes(self) -> list[str]:
        """What is unusual about the values, for a person to know."""
        if self.survey.low == self.survey.high:
            return [f"every voxel has the value {self.survey.low:.7g}: the volume is a block without structure"]
        return []

    def subject(self, quantise: Quantise = Quantise()) -> Subject:  # noqa: B008 - immutable
        """What scenes are made for, under the scene's window. Raises BadInput for one without a scale."""
        window = self.quantisation(quantise).window
        return subject_of(self.description, self.survey, self.density_counts, window)

    def default_scene(self) -> Scene:
        """A scene chosen from the data, so that the first picture is never empty."""
        return default_scene(self.subject())
