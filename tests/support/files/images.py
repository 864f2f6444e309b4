"""Images in files, read for tests."""

from pathlib import Path

import OpenImageIO as oiio
import torch
from torch import Tensor

from volsplat.protocol.description.colours import Colour


def read_image(path: Path) -> Tensor:
    """(H, W, C) float32, alpha associated, 8 and 16 bits as 0..1."""
    opened = oiio.ImageInput.open(str(path))
    assert opened is not None, oiio.geterror()
    pixels = opened.read_image("float")
    opened.close()
    return torch.from_numpy(pixels)


def over_background(image: Tensor, background: Colour) -> Tensor:
    """(H, W, 4) with associated alpha over an opaque colour: (H, W, 3)."""
    return image[..., :3] + (1.0 - image[..., 3:4]) * torch.tensor(background)
