"""Figures in files: pixels in the formats of images, SVG and PDF with the picture inside; whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.client.figure.characters import check_words
from volsplat.client.figure.figure import BARE, Figure
from volsplat.client.figure.layout import laid_out
from volsplat.client.figure.painted import painted
from volsplat.client.figure.pdf_file import pdf_bytes
from volsplat.client.figure.svg_file import svg_text
from volsplat.client.files.whole_file import whole_file
from volsplat.client.image.file_bytes import bytes_of
from volsplat.client.image.image_file import straight, write_image
from volsplat.client.image.image_formats import VECTOR_FORMATS, check_picture_writable
from volsplat.client.image.image_properties import image_properties
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene


def write_picture(
    path: Path,
    picture: NDArray[np.float32],
    scene: Scene,
    volume: SurveyedVolume,
    figure: Figure | None,
) -> None:
    """Write a finished picture of the scene, (H, W, 4) float32 with associated alpha; as a figure if there is one.

    Every file holds the scene and tells of the volume. Raises BadInput; an older file of that name then stays as it
    was.
    """
    kind = path.suffix.lower()
    properties = image_properties(volume.description, volume.settled(scene))
    if figure is None and kind not in VECTOR_FORMATS:
        write_image(path, picture, scene, properties)
        return
    figure = figure or BARE
    check_picture_writable(path, figure.transparent)
    check_words(figure, path)
    write = partial(_write_pixels, scene=scene, properties=properties, figure=figure)
    drawing = laid_out(picture, figure, scene, volume)
    if kind == ".svg":
        _write_whole(path, svg_text(drawing, bytes_of(".png", lambda place: write(place, picture))).encode())
    elif kind == ".pdf":
        pixels = straight(picture, drawing.background)
        stored = msgspec.json.encode(scene).decode()
        _write_whole(path, pdf_bytes(drawing, pixels, figure.title or volume.description.name, stored))
    else:
        write(path, painted(drawing))


def _write_pixels(
    path: Path, pixels: NDArray[np.float32], scene: Scene, properties: Mapping[str, str], figure: Figure
) -> None:
    write_image(path, pixels, scene, properties, dpi=figure.resolution, transparent=figure.transparent)


def _write_whole(path: Path, content: bytes) -> None:
    """Write beside the target, then rename: whoever looks finds the old file or the new one."""
    with whole_file(path, "cannot write the figure") as file:
        file.write(content)
