"""What one volume looks like, for another one: its tables, or all of its scene."""

from __future__ import annotations

import msgspec

from volsplat.client.scene.default_scene import is_shown_as_labels
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene


def with_tables_of(kept: Scene, scene: Scene, before: SurveyedVolume, volume: SurveyedVolume) -> Scene:
    """The `scene` of a volume, with the tables `kept` of the volume seen `before`, and what indexes them.

    Values in the same unit keep their colours: then the density window is kept as well.
    """
    look = {part: getattr(kept, part) for part in ("tables", "cross_bar", "plane", "shading")}
    scene = msgspec.structs.replace(scene, **look)
    if volume.prepared is not None or before.description.value_unit != volume.description.value_unit:
        return scene
    window = before.windowed(kept).quantise.window
    return msgspec.structs.replace(scene, quantise=msgspec.structs.replace(scene.quantise, window=window))


def with_look_of(kept: Scene, scene: Scene, before: SurveyedVolume, volume: SurveyedVolume, in_one_file: bool) -> Scene:
    """All of the scene `kept` for a volume of the same series. Any other keeps the `scene` that suits it."""
    if not _is_of_the_series(before, volume, in_one_file):
        return scene
    if volume.prepared is not None:
        return msgspec.structs.replace(kept, quantise=scene.quantise)
    return before.windowed(kept)


def _is_of_the_series(before: SurveyedVolume, volume: SurveyedVolume, in_one_file: bool) -> bool:
    """Whether both have the same grid, and values of the same meaning.

    In one file what the values are called tells the parts apart: there a step of time may have a name of its own.
    """
    seen, told = before.description, volume.description
    return (
        told.geometry.is_like(seen.geometry)
        and (told.value_unit, told.kind, told.bands) == (seen.value_unit, seen.kind, seen.bands)
        and told.second_scalar == seen.second_scalar
        and (in_one_file or told.density_name == seen.density_name)
        and is_shown_as_labels(volume.subject()) == is_shown_as_labels(before.subject())
    )
