"""The image's size: as large as a window, or fixed; and a scene that gets another one."""

from __future__ import annotations

from collections.abc import Hashable

from volsplat.client.scene.resized import sized
from volsplat.protocol.description.scene import LEAST_ZOOM, Scene

Pixels = tuple[int, int]  # width and height


class ImageSize:
    """Whether the image is as large as the window that was used last, or what the scene says."""

    def __init__(self) -> None:
        self.follows_window = True
        self._windows: dict[Hashable, Pixels] = {}  # by viewports, the one that was used last at the end

    @property
    def has_windows(self) -> bool:
        return bool(self._windows)

    def opened_or_resized(self, viewport: Hashable, window: Pixels) -> None:
        """A viewport has so many pixels, which counts as using it."""
        self._windows.pop(viewport, None)
        self._windows[viewport] = window

    def came_back(self, viewport: Hashable, window: Pixels) -> None:
        """A viewport has as many pixels as before its line was cut; nobody need be at it."""
        self._windows = {viewport: window, **self._windows}

    def used(self, viewport: Hashable) -> None:
        """A person did something in it."""
        if viewport in self._windows:
            self._windows[viewport] = self._windows.pop(viewport)

    def closed(self, viewport: Hashable) -> None:
        """It is gone; the one that was used before it counts again."""
        self._windows.pop(viewport, None)

    def fitted(self, scene: Scene) -> Scene:
        """The scene in the size that its image is to have."""
        if not self.follows_window or not self._windows:
            return scene
        width, height = next(reversed(self._windows.values()))
        return sized(scene, width=width, height=height)


def scaled(scene: Scene, share: float) -> Scene:
    """The scene in an image of which each side is about this share as long, at least one pixel.

    It is longer where a view of all of a very long volume could not be told as small.
    """
    if scene.view.zoom != "fit":
        share = min(max(share, LEAST_ZOOM / scene.view.zoom), 1.0)
    width, height = (max(1, round(side * share)) for side in (scene.image.width, scene.image.height))
    return sized(scene, width=width, height=height)
