"""Whose window the image is as large as."""

from __future__ import annotations

import hypothesis.strategies as st
import pytest
from hypothesis import given

from support.scenes.arbitrary import plain_scene
from volsplat.client.ui.viewing.image_size import ImageSize, scaled
from volsplat.protocol.description.scene import LEAST_ZOOM, View


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


@given(zoom=st.floats(LEAST_ZOOM, 256.0), share=st.floats(0.05, 1.0))
def test_a_smaller_image_shows_as_much_of_the_volume_as_before(zoom: float, share: float) -> None:
    """Else the picture would jump while a hand moves it."""
    scene = plain_scene(size=(512, 384), view=View(zoom=zoom))
    smaller = scaled(scene, share)
    assert isinstance(smaller.view.zoom, float)
    assert smaller.view.zoom * scene.image.height == pytest.approx(zoom * smaller.image.height, rel=0.01)
