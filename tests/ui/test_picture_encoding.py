"""Images as the page receives them."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as PillowImage
from torch import Tensor

from volsplat.client.image.image_file import coded
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.ui.viewing.picture_encoding import encoded, screen_levels
from volsplat.protocol.description.colours import Colour

# Halfway between two levels either is right, and a whole background would differ.
channels = st.floats(0, 1, width=32).filter(lambda value: abs(255 * value % 1 - 0.5) > 1e-3)
backgrounds = st.just((0.0, 0.0, 0.0)) | st.tuples(channels, channels, channels)


def some_image(seed: int, height: int = 9, width: int = 14) -> Tensor:
    """Associated, with pixels that are empty and some that are opaque."""
    chance = torch.Generator().manual_seed(seed)
    alpha = (1.6 * torch.rand(height, width, 1, generator=chance) - 0.3).clamp(0, 1)
    return torch.cat((alpha * torch.rand(height, width, 3, generator=chance), alpha), dim=2)


@given(st.integers(0, 1 << 20), backgrounds)
def test_levels_on_the_screen_are_those_of_a_saved_image_but_for_rounding(seed: int, background: Colour) -> None:
    image = some_image(seed)
    levels = screen_levels(PublishedImage.of(image), background)
    shown = torch.frombuffer(bytearray(levels), dtype=torch.uint8).reshape(9, 14, 4)[..., :3]
    saved = torch.from_numpy(coded(image.numpy(), background))
    assert (shown.int() - saved.int()).abs().max() <= 1
    assert (shown == saved).float().mean() > 0.99


def test_what_lies_outside_0_to_1_is_cut() -> None:
    image = torch.tensor([[[1.5, -0.5, 0.5, 1.0]]])
    assert screen_levels(PublishedImage.of(image), (0.0, 0.0, 0.0))[:3] == bytes((255, 0, 128))


@pytest.mark.parametrize(("lossless", "format"), [(True, "PNG"), (False, "JPEG")])
def test_a_picture_has_the_image_over_its_background(lossless: bool, format: str) -> None:
    image = torch.zeros(8, 16, 4)
    image[:, :8] = torch.tensor([0.5, 0.25, 0.0, 0.5])
    data = encoded(PublishedImage.of(image), (0.0, 0.0, 1.0), lossless=lossless)
    picture = PillowImage.open(io.BytesIO(data))
    assert (picture.format, picture.size) == (format, (16, 8))
    near = 0 if lossless else 3
    assert picture.getpixel((2, 4)) == pytest.approx((128, 64, 128), abs=near)
    assert picture.getpixel((13, 4)) == pytest.approx((0, 0, 255), abs=near)


def test_pictures_need_no_torch() -> None:
    program = (
        "import sys\n"
        "from volsplat.client.session.published_image import PublishedImage\n"
        "from volsplat.client.session.renderer import laid_over\n"
        "from volsplat.client.ui.viewing.picture_encoding import encoded\n"
        "image = PublishedImage(bytearray(64), 2, 2)\n"
        "for lossless in (False, True):\n"
        "    assert encoded(laid_over(image, image), (0.0, 0.5, 0.0), lossless=lossless)\n"
        "assert 'torch' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
