"""The views of the benchmarks: once around a volume, at a size that does not depend on the image."""

import msgspec

from volsplat.protocol.description.scene import Image, Scene, View
from volsplat.protocol.description.view_rotation import Quaternion, rotation_from_angles
from volsplat.protocol.description.volume import Geometry

ELEVATION = 12.0  # degrees, so that no view lies along an axis
FIRST_AZIMUTH = 5.0
SEEN_OF_LONGEST = 0.55  # half the image's height in longest sides of the volume


def around(views: int) -> list[Quaternion]:
    """Rotations once around the vertical axis, seen from a little above."""
    return [rotation_from_angles(FIRST_AZIMUTH + 360.0 * n / views, ELEVATION) for n in range(views)]


def benchmark_zoom(geometry: Geometry, height: int) -> float:
    """Pixels a reference spacing at which half of `height` is 0.55 of the volume's longest side."""
    longest = max(count * step for count, step in zip(geometry.dims, geometry.spacing, strict=True))
    return height / 2 / (SEEN_OF_LONGEST * longest) * geometry.reference_spacing


def seen(scene: Scene, geometry: Geometry, rotation: Quaternion, size: tuple[int, int]) -> Scene:
    """The scene in a view of the benchmarks, in an image of so many pixels (width, height)."""
    width, height = size
    return msgspec.structs.replace(
        scene,
        view=View(rotation=rotation, zoom=benchmark_zoom(geometry, height)),
        image=Image(width=width, height=height, background=scene.image.background),
    )
