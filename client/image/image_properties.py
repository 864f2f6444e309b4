"""What a saved image says of the volume beside its scene: whoever finds it knows what it shows, and how large."""

from __future__ import annotations

import msgspec

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.rules.resolved_view import resolved_zoom

VOLUME, PIXEL_SIZE = "volume", "pixel_size"


def image_properties(description: VolumeDescription, scene: Scene) -> dict[str, str]:
    """For write_image: the description as JSON, and the length that a pixel spans, as in "0.52 mm".

    Lengths are in the file's unit; without one the pixel's is in voxels.
    """
    geometry = description.geometry
    per_pixel = (geometry.reference_spacing if description.unit else 1.0) / resolved_zoom(scene, geometry)
    return {
        VOLUME: msgspec.json.encode(description).decode(),
        PIXEL_SIZE: f"{per_pixel:.6g} {description.unit or 'voxels'}",
    }
