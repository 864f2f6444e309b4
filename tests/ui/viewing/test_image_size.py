"""Whose window the image is as large as."""

from __future__ import annotations

from support.scenes.arbitrary import plain_scene
from volsplat.client.ui.viewing.image_size import ImageSize


def width(size: ImageSize) -> int:
    return size.fitted(plain_scene()).image.width


def test_a_window_whose_line_was_cut_comes_back_without_taking_the_image_from_the_one_in_use() -> None:
    size = ImageSize()
    size.opened_or_resized("in use", (100, 100))
    size.came_back("cut", (200, 200))
    assert width(size) == 100
    size.used("cut")
    assert width(size) == 200
    size.closed("cut")
    size.closed("in use")
    size.came_back("cut", (200, 200))
    assert width(size) == 200, "it is the only one"
