"""What one volume looks like, for another one: its tables, or all of its scene."""

from __future__ import annotations

import msgspec

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
    window = before.quantisation(kept.quantise).window
    return msgspec.structs.replace(scene, quantise=msgspec.structs.replace(scene.quantise, window=window))


def with_look_of(kept: Scene, scene: Scene, before: SurveyedVolume, volume: SurveyedVolume) -> Scene:
    """All of the scene `kept` for a volume of the same series: on the same grid, with values in the same unit.

    Any other keeps the `scene` that suits it.
    """
    seen, told = before.description, volume.description
    if not told.geometry.is_like(seen.geometry) or told.value_unit != seen.value_unit:
        return scene
    if volume.prepared is not None:
        return msgspec.structs.replace(kept, quantise=scene.quantise)
    return before.windowed(kept)
