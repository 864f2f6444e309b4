"""The volume as the client knows it; scenes and quantisation follow from it."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache, partial
from typing import Any

import msgspec

from volsplat.client.histogram.density_histogram import DensityHistogram
from volsplat.client.histogram.subject import Subject, subject_of
from volsplat.client.scene.default_scene import default_scene, is_shown_as_labels
from volsplat.client.scene.presets import preset_scene
from volsplat.client.scene.resized import allowed_zoom
from volsplat.client.volume.up_guess import StandsUp, stands_up
from volsplat.client.volume.visible_part import (
    Extent,
    Points,
    extent_from,
    extent_in_a_turn,
    fitting_view,
    visible_points,
)
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.kind import CLASS_KINDS, Kind
from volsplat.protocol.description.patches import Plane, colourless
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Quantise, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.geometry.upright import Up
from volsplat.protocol.rules import index_rules
from volsplat.protocol.rules.index_rules import Quantisation, Survey
from volsplat.protocol.rules.levels import Prepared
from volsplat.protocol.rules.refinement import STEP_RULES
from volsplat.protocol.rules.resolved_view import resolved_center, resolved_zoom
from volsplat.protocol.text.errors import BadInput

REMEMBERED = 16  # scenes, and windows
NO_COLOUR = ColourTable(points=((0.0, (0.0, 0.0, 0.0)),))

LIKE_A_FILL_VALUE = 1e15  # 1e20, 9.97e36 and 3.4e38 are in use; hardly any data reaches as far
MASK = 2  # values: what lies between is how near the one surface is
NEARLY_ALL = 0.95  # of the voxels, in the first and the last of the survey's bins
TINY = 1e-150  # products of gradients below it are lost in float64
EXACT_INTEGERS = 2.0**53  # float64, in which all is computed, has not each of those beyond
_MARK_IT = "mark it so (NaN, a fill value)"


@dataclass(frozen=True)
class SurveyedVolume:
    """What is known of a volume once every server has read its sub-cube."""

    description: VolumeDescription
    survey: Survey
    density_counts: list[int]  # over the values' range in survey.ranges
    strength_counts: list[int]  # over strength_range
    extremes: BlockExtremes
    prepared: Prepared | None = None  # where its packets were made before

    def __repr__(self) -> str:
        """Not all that was counted."""
        told, survey = self.description, self.survey
        size = " x ".join(map(str, told.geometry.dims))
        return f"<volsplat volume {told.name}: {size} voxels of {told.scalar_type}, {survey.low:g} to {survey.high:g}>"

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: what it is made of, without what was worked out from that."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def automatic_window(self) -> tuple[float, float]:
        """The density window that the data chooses, in its own units; or with which it was prepared."""
        if self.prepared is not None:
            return self.prepared.quantisation.window
        told = self.description
        return index_rules.density_window(self.survey, self.density_counts, told.scalar_type, told.kind)

    @property
    def strength_range(self) -> tuple[float, float]:
        """What the packets' second byte may hold: |gradient|, or a second scalar."""
        return self.description.second_scalar or (0.0, self.survey.ranges.max_gradient)

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
            has_strength=self.description.second_scalar is None,
        )

    def windowed(self, scene: Scene) -> Scene:
        """The scene with the density window that it has for this volume, so that others show the same values alike."""
        window = self.quantisation(scene.quantise).window
        return msgspec.structs.replace(scene, quantise=msgspec.structs.replace(scene.quantise, window=window))

    def density_histogram(self, quantise: Quantise = Quantise()) -> DensityHistogram:  # noqa: B008 - immutable
        """The histogram of density bytes under the scene's window. Raises BadInput for one without a scale."""
        return self.subject(quantise).histogram

    @cached_property
    def stands_up(self) -> StandsUp:
        """Which physical axis is up where the scene leaves it open."""
        return stands_up(self.description, self.extremes)

    def has(self, step: Step) -> bool:
        """Whether there is a picture of a step."""
        return not self.why_without(step)

    def why_without(self, step: Step) -> str:
        """A line for a person if there is no picture of a step; else ""."""
        if not STEP_RULES[step].slabs or self._without_between is None:
            return ""
        name, what = self.description.name, self._without_between
        other = ", or #density of atoms in a file" if self.description.kind is Kind.ELEMENTS else ""
        return f"step {step} reconstructs values between voxels, but {name} holds {what}; draw step F{other}"

    def check_step(self, step: Step) -> None:
        """Raises BadInput for a step that this volume has no picture of."""
        if why := self.why_without(step):
            raise BadInput(why)

    @cached_property
    def _without_between(self) -> str | None:
        """What the values are if they have none in between, being no more or less than others; else None."""
        told = self.description
        if told.kind in CLASS_KINDS:
            return f"{told.kind}, which have none"
        if told.second_scalar is not None:
            return "two values each, which it would mix"
        if self.has_values and self._mixes_labels:
            low, high = self.survey.low, self.survey.high
            return f"the whole numbers {low:g} to {high:g}, which are shown as labels and have none"
        return None

    @property
    def _mixes_labels(self) -> bool:
        """Whether values between would be those of labels that lie elsewhere."""
        subject = self.subject()
        return subject.values.different > MASK and is_shown_as_labels(subject)

    def settled(self, scene: Scene) -> Scene:
        """The scene with numbers for all that its view leaves to the volume: up, and zoom and centre of a fit.

        What is seen fills a still. What does not fit the volume is left for whoever plans the frame.
        """
        view = msgspec.structs.replace(scene.view, up=self.up_in(scene))
        return self._fitted(msgspec.structs.replace(scene, view=view), extent_from)

    def up_in(self, scene: Scene) -> Up:
        """The physical axis that the scene has up."""
        return self.stands_up.up if scene.view.up == "auto" else scene.view.up

    def fitted_to_turn(self, scene: Scene) -> Scene:
        """The scene with numbers for the zoom and centre of a fit, which hold however it is turned."""
        return self._fitted(scene, extent_in_a_turn)

    def _fitted(self, scene: Scene, extent_of: Callable[[View, Geometry, Points], Extent]) -> Scene:
        if scene.view.zoom != "fit":
            return scene
        try:
            points = self._visible_points(_deciding_visibility(scene), self.quantisation(scene.quantise))
        except ValueError:  # bounds that the volume does not have
            return scene
        geometry = self.description.geometry
        zoom, center = fitting_view(scene, geometry, extent_of(scene.view, geometry, points))
        return msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom=zoom, center=center))

    @cached_property
    def _visible_points(self) -> Callable[[Scene, Quantisation], Points]:
        """Remembered, since the frames of a refinement, and a scene that is turned, have the same.

        No function that is remembered refers to this volume: it goes at once, and not when the collector next runs.
        """
        geometry, extremes = self.description.geometry, self.extremes
        return lru_cache(REMEMBERED)(lambda scene, rules: visible_points(scene, geometry, rules, extremes))

    @property
    def has_values(self) -> bool:
        """False where all are NaN or infinite."""
        return self.survey.low <= self.survey.high

    def check_has_values(self) -> None:
        """Raises BadInput if there is nothing to draw."""
        if not self.has_values:
            name = self.description.name
            raise BadInput(f"{name}: no voxel has a value, all are NaN or infinite; export the volume again")

    def warnings(self) -> list[str]:
        """What the reader and the survey warn of, a line each."""
        return [*self.description.warnings, *self.notes()]

    def notes(self) -> list[str]:
        """What is unusual about the values, for a person to know."""
        if self.survey.low == self.survey.high:
            told = "the volume is a block without structure"
            if self.description.scalar_type in ("int64", "uint64") and abs(self.survey.low) >= EXACT_INTEGERS:
                told = "none differs from it by what can be told apart beyond 2^53; subtract the least before saving"
            return [f"every voxel has the value {self.survey.low:.7g}: {told}"]
        span = self.survey.high - self.survey.low
        if span < TINY and self.survey.max_gradient < TINY:
            return [f"values that differ by {span:.2g} at most get little light or none: multiply them before saving"]
        extreme, counted = max(self.survey.low, self.survey.high, key=abs), self.survey.counted
        if counted is not None:
            told = f"all others have {counted.low:.5g} to {counted.high:.5g}, and it is drawn as an end of that"
            return [f"few voxels have values as far off as {extreme:.7g}: {told}; if it stands for no data, {_MARK_IT}"]
        at_ends = sum(self.density_counts[end] for end in (0, -1)) / max(sum(self.density_counts), 1)
        if abs(extreme) >= LIKE_A_FILL_VALUE and at_ends >= NEARLY_ALL:
            told = f"if that stands for no data, {_MARK_IT}, or give the window of the others"
            return [f"voxels that have {extreme:.7g} make nearly all others one density: {told}"]
        return []

    def subject(self, quantise: Quantise = Quantise()) -> Subject:  # noqa: B008 - immutable
        """What scenes are made for, under the scene's window. Raises BadInput for one without a scale, or no values."""
        self.check_has_values()
        return self._subject_under(self.quantisation(quantise).window)

    @cached_property
    def _subject_under(self) -> Callable[[tuple[float, float]], Subject]:
        """Remembered, since every preset is made for it."""
        up = self.stands_up.up if self.stands_up.told else "auto"
        subject = partial(subject_of, self.description, self.survey, self.density_counts, up=up)
        automatic = self.quantisation(Quantise()).window
        usual = subject(automatic)
        return lru_cache(REMEMBERED)(lambda window: usual if window == automatic else subject(window, usual=usual))

    def default_scene(self) -> Scene:
        """A scene chosen from the data, so that the first picture is never empty."""
        return self.begun_scene(None)

    def begun_scene(self, preset: str | None, quantise: Quantise = Quantise()) -> Scene:  # noqa: B008 - immutable
        """The default scene, or a preset's, with this window and tables that are made for it.

        A window that is changed afterwards would leave them where they are, at other values. Raises BadInput for a
        window without a scale, and for no such preset.
        """
        subject = self.subject(quantise)
        scene = default_scene(subject) if preset is None else preset_scene(preset, subject)
        return msgspec.structs.replace(scene, quantise=quantise)


def asking_for_fit(scene: Scene) -> Scene:
    """The scene from the same side, with zoom and centre left to what is visible."""
    return msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom="fit", center="middle"))


def showing_all(scene: Scene, geometry: Geometry) -> Scene:
    """The scene from the same side, with the whole volume in the image, whatever its tables and bounds show of it."""
    whole = asking_for_fit(scene)
    zoom, center = allowed_zoom(resolved_zoom(whole, geometry)), resolved_center(whole, geometry)
    return msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom=zoom, center=center))


def _deciding_visibility(scene: Scene) -> Scene:
    """The scene with whatever does not decide what is visible left as it is in every scene."""
    plain = Scene(tables=scene.tables)
    return msgspec.structs.replace(
        plain,
        tables=msgspec.structs.replace(scene.tables, emit=NO_COLOUR, refl=NO_COLOUR),
        plane=Plane(patches=colourless(scene.plane.patches)),
        cross_bar=msgspec.structs.replace(plain.cross_bar, opac=scene.cross_bar.opac, modu=scene.cross_bar.modu),
        shading=msgspec.structs.replace(plain.shading, modulation=scene.shading.modulation),
        bounds=scene.bounds,
        image=msgspec.structs.replace(plain.image, edges=scene.image.edges),
        quantise=scene.quantise,
    )
