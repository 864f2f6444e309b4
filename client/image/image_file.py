"""Images on disk, by OpenImageIO: written whole or not at all, and always with the scene that made them.

Values are display-referred sRGB 0..1 and are never converted. EXR and PNG carry one attribute for each property;
JPEG and TIFF have room for a single text, which holds all of them as a JSON object.
"""

import base64
import json
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike, NDArray

from volsplat.client.caller.arguments import checked_scene
from volsplat.client.files.whole_file import whole_file
from volsplat.client.image.embedded_picture import SVG, embedded_png
from volsplat.client.image.image_formats import EXACT, check_writable
from volsplat.program.temporary_folder import temporary_folder
from volsplat.program.temporary_name import behind_links
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.file_names import check_utf8

JPEG_QUALITY = 95

Coding = Callable[[NDArray[Any], Colour | None], NDArray[Any]]

_PREFIX = "volsplat:"
SCENE_KEY = f"{_PREFIX}scene"  # by which other programs find it
_ONE_TEXT = (".jpg", ".jpeg", ".tif", ".tiff")
_PACKED = "zlib,base64:"
_BLOCK_PIXELS = 1 << 20  # converted at a time, so that a large image is not held twice
_BLOCK_ROWS = 64  # of which blocks are multiples: a format packs up to so many together
_LONGEST_COMPLAINT = 200  # characters of what a library says
_TRIAL_BYTES = 1 << 20
_ENDS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}  # of files; others have an index
_CUT_OFF = "its end is missing"
_LONGEST_UNPACKED = 1 << 24  # bytes of a text in a picture, which may come from anybody
_LONGEST_COMMENT = 60000  # bytes; a JPEG segment ends at 65535, and libjpeg ends the process beyond it


def write_image(
    path: Path,
    image: ArrayLike,
    scene: Scene,
    properties: Mapping[str, str] | None = None,
    *,
    dpi: float | None = None,
    transparent: bool = False,
) -> None:
    """Write an (H, W, 4) float32 image with associated alpha; equal images give equal bytes.

    The scene's background is put under the image, unless it is to be `transparent`, and except in EXR, which keeps
    alpha. `properties` are stored beside the scene, and `dpi` as the pixels per inch. Raises BadInput if the file
    cannot be written; an older file of that name then stays as it was.
    """
    scene = checked_scene(scene)
    background = None if transparent or path.suffix.lower() == EXACT else scene.image.background
    stored = {"scene": msgspec.json.encode(scene).decode(), **(properties or {})}
    _write(path, image, background, stored, JPEG_QUALITY, dpi, straight if transparent else coded)


def write_pixels(path: Path, pixels: ArrayLike, jpeg_quality: int = JPEG_QUALITY) -> None:
    """Write (H, W, C) values 0..1 as they are, without a scene. Otherwise as write_image."""
    _write(path, pixels, None, {}, jpeg_quality, None, coded)


def read_scene(path: Path) -> Scene:
    """The scene stored in an image that volsplat wrote. Raises BadInput."""
    text = read_properties(path).get("scene")
    if text is None:
        raise BadInput(f"{path}: holds no scene; only images that volsplat wrote do")
    try:
        return msgspec.json.decode(text, type=Scene)
    except msgspec.MsgspecError as error:
        raise BadInput(f"{path}: the scene stored in it cannot be used: {_one_line(str(error))}") from error


def read_properties(path: Path) -> dict[str, str]:
    """What volsplat stored with an image: "scene" as JSON, and whatever else was given. Raises BadInput."""
    if path.suffix.lower() == SVG:
        with temporary_folder() as folder:
            inside = folder / "picture.png"
            inside.write_bytes(embedded_png(path))
            return read_properties(inside)
    opened = _opened(path)
    try:
        spec = opened.spec()
        stored = {a.name.removeprefix(_PREFIX): str(a.value) for a in spec.extra_attribs if a.name.startswith(_PREFIX)}
        return stored or _from_description(spec.get_string_attribute("ImageDescription"))
    finally:
        opened.close()


def over_background(image: NDArray[np.float32], background: Colour) -> NDArray[np.float32]:
    """(H, W, 4) with associated alpha over an opaque colour: (H, W, 3)."""
    return image[..., :3] + (1.0 - image[..., 3:4]) * np.array(background, image.dtype)


def _write(
    path: Path,
    values: ArrayLike,
    background: Colour | None,
    properties: Mapping[str, str],
    jpeg_quality: int,
    dpi: float | None,
    code: Coding,
) -> None:
    """As write_pixels, over `background` if there is one."""
    check_writable(path)
    kind = path.suffix.lower()
    if kind == EXACT:
        code = exact
    pixels = np.asarray(values)
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels if background is None else 3, "float" if code is exact else "uint8")
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute("DateTime", "")  # otherwise the time of writing is stored
    if kind in (".jpg", ".jpeg"):
        spec.attribute("Compression", f"jpeg:{jpeg_quality}")
        spec.attribute("jpeg:subsampling", "4:4:4")
    else:
        spec.attribute("Compression", "zip")
    if code is straight:
        spec.attribute("oiio:UnassociatedAlpha", 1)
    if dpi is not None:
        for name in ("XResolution", "YResolution"):
            spec.attribute(name, float(dpi))
        spec.attribute("ResolutionUnit", "in")
    _store(spec, path, properties)
    _write_whole(path, spec, _coded_blocks(pixels, background, code))


def _coded_blocks(pixels: NDArray[Any], background: Colour | None, code: Coding) -> Iterator[NDArray[Any]]:
    rows = max(_BLOCK_PIXELS // pixels.shape[1] // _BLOCK_ROWS, 1) * _BLOCK_ROWS
    for first in range(0, len(pixels), rows):
        yield code(pixels[first : first + rows], background)


def exact(block: NDArray[Any], _: Colour | None) -> NDArray[np.float32]:
    """Rows of pixels (H, W, C) as they are."""
    return np.ascontiguousarray(block, np.float32)


def coded(block: NDArray[Any], background: Colour | None) -> NDArray[np.uint8]:
    """Rows of pixels (H, W, C) in 8 bits; over the background, without alpha, if there is one."""
    if background is not None:
        block = over_background(block, background)
    levels: NDArray[np.float64] = np.clip(block, 0.0, 1.0).astype(np.float64) * 255 + 0.5
    return levels.astype(np.uint8)  # which cuts off


def straight(block: NDArray[Any], background: Colour | None) -> NDArray[np.uint8]:
    """As `coded`; of what has no background the colours as they are, not multiplied by alpha, as in PNG."""
    if background is None:
        alpha = block[..., 3:4]
        colours = np.divide(block[..., :3], alpha, out=np.zeros_like(block[..., :3]), where=alpha > 0)
        block = np.concatenate((colours, alpha), axis=2)
    return coded(block, background)


def _store(spec: "oiio.ImageSpec", path: Path, properties: Mapping[str, str]) -> None:
    if not properties:
        return
    if path.suffix.lower() not in _ONE_TEXT:
        for name, value in properties.items():
            spec.attribute(_PREFIX + name, value)
        return
    text = json.dumps({_PREFIX + name: value for name, value in properties.items()})
    if len(text) > _LONGEST_COMMENT:
        text = _PACKED + base64.b64encode(zlib.compress(text.encode(), 9)).decode()
    if len(text) > _LONGEST_COMMENT and path.suffix.lower() in (".jpg", ".jpeg"):
        raise BadInput(f"{path}: the scene's tables have too many points for a JPEG file; write PNG, TIFF or EXR")
    spec.attribute("ImageDescription", text)


def _from_description(text: str) -> dict[str, str]:
    """The properties in a JPEG's or TIFF's text; none if another program wrote it."""
    try:
        if text.startswith(_PACKED):
            text = _unpacked(text.removeprefix(_PACKED))
        found = json.loads(text)
    except (ValueError, RecursionError, zlib.error):
        return {}
    if not isinstance(found, dict):
        return {}
    return {name.removeprefix(_PREFIX): str(value) for name, value in found.items() if name.startswith(_PREFIX)}


def _unpacked(text: str) -> str:
    """Raises ValueError and zlib.error for what this module did not pack, as for what is too long."""
    stream = zlib.decompressobj()
    unpacked = stream.decompress(base64.b64decode(text), _LONGEST_UNPACKED)
    if not stream.eof:
        raise ValueError("it is truncated, or too long")
    return unpacked.decode()


def _opened(path: Path) -> "oiio.ImageInput":
    if not path.is_file():
        raise BadInput(f"{path}: no such image file")
    check_utf8(path)
    opened = oiio.ImageInput.open(str(path))
    if opened is None:
        raise BadInput(f"{path}: cannot read the image: {_one_line(oiio.geterror())}")
    return opened


def _write_whole(path: Path, spec: "oiio.ImageSpec", blocks: Iterator[NDArray[Any]]) -> None:
    """Write apart, and to the path once all is there."""
    check_utf8(behind_links(path))
    try:
        with _file_for_library(path) as made:
            said = _write_to(path, made, spec, blocks)
            if said is not None or not _is_ended(made, path.suffix.lower(), spec.height):
                raise BadInput(f"{path}: cannot write the image: {_system_s_reason(made) or said or _CUT_OFF}")
            with whole_file(path, "cannot write the image") as file, made.open("rb") as image:
                shutil.copyfileobj(image, file)
    except OSError as error:
        raise BadInput(f"{path}: cannot write the image: {error.strerror}") from error


@contextmanager
def _file_for_library(path: Path) -> Iterator[Path]:
    """Where OpenImageIO writes what is to lie at `path`: in memory, if the system has files there.

    Libraries are not to be trusted with a disk that fills up: libjpeg ends the process, the others may say nothing of
    what they could not write at the end, or of a hole in the middle if there was room again.
    """
    if not hasattr(os, "memfd_create"):
        with tempfile.NamedTemporaryFile(prefix="volsplat-", suffix=path.suffix) as file:
            yield Path(file.name)
        return
    memory = os.memfd_create("image")
    try:
        yield Path(f"/proc/self/fd/{memory}")
    finally:
        os.close(memory)


def _write_to(path: Path, made: Path, spec: "oiio.ImageSpec", blocks: Iterator[NDArray[Any]]) -> str | None:
    """None if it went well, else what the library says of it. The format is that of the path's name."""
    output = oiio.ImageOutput.create(str(path))
    if output is None:
        return _one_line(oiio.geterror())
    written, row = output.open(str(made), spec), 0
    for block in blocks if written else ():
        written = output.write_scanlines(row, row + len(block), 0, block) and written
        row += len(block)
    if output.close() and written:
        return None
    return _one_line(output.geterror() or "the disk may be full")[:_LONGEST_COMPLAINT]


def _system_s_reason(path: Path) -> str:
    """Why nothing more can be written into this file, "" if something can: libraries name places in it."""
    try:
        with path.open("ab") as file:
            file.write(bytes(_TRIAL_BYTES))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _is_ended(made: Path, kind: str, height: int) -> bool:
    """Whether a file that OpenImageIO is content with has its end."""
    if (end := _ENDS.get(kind)) is not None:
        with made.open("rb") as file:
            file.seek(max(made.stat().st_size - len(end), 0))
            return file.read() == end
    opened = oiio.ImageInput.open(str(made))
    if opened is None:
        return False
    try:
        return opened.read_scanlines(height - 1, height, 0, 0, 1) is not None
    finally:
        opened.close()


def _one_line(text: str) -> str:
    return " ".join(text.split())
