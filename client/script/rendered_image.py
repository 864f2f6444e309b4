"""An image as a script has it: numbers for whoever computes, a picture for whoever looks."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volsplat.client.image.image_properties import image_properties
from volsplat.client.session.published_image import PublishedImage
from volsplat.program.extras import need
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import VolumeDescription

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from PIL.Image import Image
    from torch import Tensor


class RenderedImage:
    """(H, W, 4) float32, associated alpha, 0..1, without the background, which lies under every picture of it.

    `scene` is the one that was asked for, and `view` says what a fit came to.
    """

    def __init__(self, published: PublishedImage, scene: Scene, settled: Scene, description: VolumeDescription) -> None:
        self._published = published
        self._properties = image_properties(description, settled)
        self.scene = scene
        self.view = settled.view

    @property
    def tensor(self) -> Tensor:
        """Raises BadInput without the extra [torch]."""
        return self._published.tensor

    def numpy(self) -> NDArray[np.float32]:
        """Over the same memory as `tensor`."""
        return self._published.pixels

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        import numpy as np

        return np.array(self.numpy(), dtype, copy=copy) if copy else np.asarray(self.numpy(), dtype)

    def pil(self) -> Image:
        """Over the background, 8 bits a channel. Raises BadInput without pillow."""
        need("PIL", "an image of pillow", "ui")
        import PIL.Image

        from volsplat.client.image.image_file import coded

        return PIL.Image.fromarray(coded(self.numpy(), self.scene.image.background, "uint8"))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .png, .jpg, .tif or .exr file, which holds its scene. Raises BadInput."""
        from volsplat.client.image.image_file import write_image

        write_image(Path(path), self.numpy(), self.scene, self._properties)

    def _repr_png_(self) -> bytes:
        """For notebooks."""
        import tempfile

        with tempfile.TemporaryDirectory(prefix="volsplat-") as folder:  # OpenImageIO's Python writes to no memory
            path = Path(folder) / "image.png"
            self.save(path)
            return path.read_bytes()

    def __repr__(self) -> str:
        return f"<volsplat image of {self._published.width} x {self._published.height} pixels>"
