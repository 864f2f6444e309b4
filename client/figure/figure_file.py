"""Figures in files: pixels in the formats of images, SVG and PDF with the picture inside; whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.client.figure.characters import check_characters
from volsplat.client.figure.drawing import Words
from volsplat.client.figure.figure import BARE, Figure
from volsplat.client.figure.layout import laid_out
from volsplat.client.figure.painted import painted
from volsplat.client.figure.pdf_file import pdf_bytes
from volsplat.client.figure.svg_file import svg_text
from volsplat.client.image.image_file import straight, write_image
from volsplat.client.image.image_formats import VECTOR_FORMATS, check_picture_writable
from volsplat.client.image.image_properties import image_properties
from volsplat.client.image.temporary_name import temporary_name
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput


def write_picture(
    path: Path,
    picture: NDArray[np.float32],
    scene: Scene,
    volume: SurveyedVolume,
    figure: Figure | None = None,
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
    drawing = laid_out(picture, figure, scene, volume)
    if kind == ".svg":
        _write_whole(path, svg_text(drawing, _png_bytes(picture, figure, scene, properties)).encode())
        return
    check_characters(shape.text for shape in drawing.shapes if isinstance(shape, Words))
    if kind == ".pdf":
        pixels = straight(picture, drawing.background, "uint8")
        stored = msgspec.json.encode(scene).decode()
        _write_whole(path, pdf_bytes(drawing, pixels, figure.title or volume.description.name, stored))
    else:
        write_image(path, painted(drawing), scene, properties, dpi=figure.dpi, transparent=figure.transparent)


def _png_bytes(picture: NDArray[np.float32], figure: Figure, scene: Scene, properties: Mapping[str, str]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="volsplat-") as folder:  # OpenImageIO's Python writes to no memory
        path = Path(folder) / "picture.png"
        write_image(path, picture, scene, properties, dpi=figure.dpi, transparent=figure.transparent)
        return path.read_bytes()


def _write_whole(path: Path, content: bytes) -> None:
    """Write beside the target, then rename: whoever looks finds the old file or the new one."""
    target = Path(os.path.realpath(path))
    temporary = temporary_name(target)
    try:
        temporary.write_bytes(content)
        os.replace(temporary, target)
    except OSError as error:
        raise BadInput(f"{path}: cannot write the figure: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)
