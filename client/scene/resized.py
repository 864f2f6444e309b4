"""A scene that gets an image of another size."""

from __future__ import annotations

import msgspec

from volsplat.protocol.description.scene import GREATEST_ZOOM, LEAST_ZOOM, Scene


def allowed_zoom(zoom: float) -> float:
    """What a scene may say, nearest to this."""
    return min(max(zoom, LEAST_ZOOM), GREATEST_ZOOM)


def sized(scene: Scene, *, width: int | None = None, height: int | None = None) -> Scene:
    """The scene with an image of another size, in pixels, and as much of the volume in it as before."""
    old, view = scene.image, scene.view
    image = msgspec.structs.replace(
        old, width=old.width if width is None else width, height=old.height if height is None else height
    )
    if view.zoom != "fit":
        zoom = view.zoom * min(image.width, image.height) / min(old.width, old.height)
        view = msgspec.structs.replace(view, zoom=allowed_zoom(zoom))
    return msgspec.structs.replace(scene, image=image, view=view)
