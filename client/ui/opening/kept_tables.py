"""The tables of one volume for another one."""

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
