"""An image as a script has it: numbers for whoever computes, a picture for whoever looks."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volsplat.client.figure.figure import Figure, figure_with
from volsplat.client.image.file_bytes import bytes_of
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.script.picture_names import note_written
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.extras import need
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from PIL.Image import Image
    from torch import Tensor


class RenderedImage:
    """(H, W, 4) float32, associated alpha, 0..1, without the background, which lies under every picture of it.

    `scene` is the one that was asked for, and `view` says what a fit came to.
    """

    def __init__(
        self, published: PublishedImage, scene: Scene, volume: SurveyedVolume, volume_path: str | None
    ) -> None:
        """`volume_path` is None of an array in memory, and of what lies where servers see it alone."""
        self._published = published
        self._volume = volume
        self.volume_path = volume_path
        self.scene = scene
        self.view = volume.settled(scene).view

    @property
    def volume_name(self) -> str:
        """As people know it."""
        return self._volume.description.name

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
        return _pil(self.numpy(), self.scene.image.background)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .png, .jpg, .tif, .exr, .svg or .pdf file, which holds its scene. Raises BadInput."""
        _save(Path(path), self, self._volume, None)

    def figure(self, **options: Any) -> RenderedFigure:
        """With scale bar, colour bar and sides; options as of `volsplat.Figure`. Raises BadInput.

        A finished picture keeps its pixels: `dpi` says how large it is printed.
        """
        if "width" in options or "height" in options:
            raise BadInput("width and height are for vs.render(..., figure=vs.Figure(...)), which draws as many pixels")
        return RenderedFigure(self, figure_with(Figure(), options), self._volume)

    def _repr_png_(self) -> bytes:
        """For notebooks."""
        return bytes_of(".png", self.save)

    def __repr__(self) -> str:
        return f"<volsplat image of {self._published.width} x {self._published.height} pixels>"


class RenderedFigure:
    """A rendered image with all that a figure shows beside it; `image` is the image alone."""

    def __init__(self, image: RenderedImage, figure: Figure, volume: SurveyedVolume) -> None:
        self.image = image
        self.options = figure
        self._volume = volume

    def numpy(self) -> NDArray[np.float32]:
        """As pixels, (H, W, 4) float32, associated alpha, 0..1, without the background."""
        from volsplat.client.figure.layout import laid_out
        from volsplat.client.figure.painted import painted

        return painted(laid_out(self.image.numpy(), self.options, self.image.scene, self._volume))

    def pil(self) -> Image:
        """Over the background unless it is transparent, 8 bits a channel. Raises BadInput without pillow."""
        return _pil(self.numpy(), None if self.options.transparent else self.image.scene.image.background)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .pdf or .svg file with the picture inside, or a .png, .jpg, .tif or .exr. Raises BadInput."""
        _save(Path(path), self.image, self._volume, self.options)

    def _repr_png_(self) -> bytes:
        """For notebooks."""
        return bytes_of(".png", self.save)

    def __repr__(self) -> str:
        return f"<volsplat figure of {self.image!r}>"


def _save(path: Path, image: RenderedImage, volume: SurveyedVolume, figure: Figure | None) -> None:
    from volsplat.client.figure.figure_file import write_picture

    if image.volume_path is not None:
        check_written_apart(image.volume_path, path)
    write_picture(path, image.numpy(), image.scene, volume, figure)
    note_written(path)


def _pil(pixels: NDArray[np.float32], background: Colour | None) -> Image:
    need("PIL", "an image of pillow", "ui")
    import PIL.Image

    from volsplat.client.image.image_file import straight

    return PIL.Image.fromarray(straight(pixels, background))
