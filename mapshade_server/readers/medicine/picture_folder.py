"""Folders of pictures, one slice in each: PNG, JPEG and BMP, through OpenImageIO.

Pictures state no sizes of voxels: `scans/#spacing=0.5x0.5x2,unit=mm` does. What stands before that is how the names
begin: `scans/left_,spacing=0.5x0.5x2`. Colours are not mixed to a grey: `channel=R` is one of them.
"""

import importlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart, array_part
from volsplat.mapshade_server.readers.medicine.slice_files import slices_in
from volsplat.mapshade_server.readers.reading.grids import checked_geometry, refuse_other_dimensions
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.volume_files import disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import SCALAR_TYPES, FolderFormat, OpenedVolume, Voxels
from volsplat.protocol.description.slice_folders import PICTURES, slice_kind, visible_files
from volsplat.protocol.description.volume import Box, VolumeDescription
from volsplat.protocol.text.errors import BadInput

OPTIONS = ("spacing", "unit", "channel")
ALPHA = "A"
MOST_GROWTH = 1032  # of one byte, by deflate; JPEG's empty blocks become less
ENDS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}
TAIL_BYTES = 4096
UPRIGHT = 1  # of the tag Orientation
NO_SIZES = "pictures state no size of their voxels: taken as cubes; #spacing=1x1x2,unit=mm would set it"


@dataclass(frozen=True)
class _Picture:
    """What all pictures of a volume have in common."""

    width: int
    height: int
    channels: tuple[str, ...]
    dtype: str


def open_picture_folder(folder: Path, part: str) -> OpenedVolume:
    """The reader for the pictures whose names begin as the part says.

    Raises BadInput if they differ, if one is missing or truncated, and if a colour must be chosen.
    """
    said = array_part(folder, part)
    said.check_known(OPTIONS)
    paths = slices_in(folder, said.path, PICTURES, "picture")
    first = _told(paths[0])
    dims = (first.width, first.height, len(paths))
    refuse_other_dimensions(folder, dims if len(paths) > 1 else dims[:2])
    for path in paths[1:]:
        if _told(path) != first:
            raise BadInput(
                f"{folder}: {path.name} differs from {paths[0].name} in size, colours or type; put one stack alone "
                "into a folder"
            )
    channel = _channel(said, paths, first)
    steps = said.numbers("spacing", 3)
    name = folder.resolve().name
    description = VolumeDescription(
        name=f"{name}#{part}" if part else name,
        format=f"folder of {len(paths)} {paths[0].suffix[1:].upper()} pictures",
        geometry=checked_geometry(folder, dims, steps or (1.0, 1.0, 1.0)),
        scalar_type=first.dtype,
        unit=said.options.get("unit", ""),
        density_name=first.channels[channel] if len(_colours(first)) > 1 else "",
        warnings=() if steps else (NO_SIZES,),
        why_whole="each picture is decoded down to the last row of the box",
    )

    def read(box: Box) -> Voxels:
        voxels = np.empty(box.size[::-1], first.dtype)
        for n, path in enumerate(paths[box.low[2] : box.high[2]]):
            rows = _rows(path, first, box)
            if not (said.options.get("channel") or _are_grey(rows, first)):
                raise _in_colour(said, path, first)
            voxels[n] = rows[:, box.low[0] : box.high[0], channel]
        return voxels

    return OpenedVolume(description, read, lambda: disk_files(paths), parts=())


def _told(path: Path) -> _Picture:
    """What a picture's header says. Raises BadInput if it cannot be read, or is to be turned."""
    _check_ends(path)
    with _opened(path) as picture:
        spec = picture.spec()
        told = _Picture(spec.width, spec.height, tuple(spec.channelnames), str(spec.format))
        turned = spec.get_int_attribute("Orientation", UPRIGHT) != UPRIGHT
    if turned:
        raise BadInput(f"{path}: is stored turned, to be set upright by its Orientation; save it upright")
    if told.dtype not in SCALAR_TYPES:
        raise BadInput(f"{path}: has pixels of type {told.dtype}, which is not read; save it as 8 or 16 bits")
    promised = told.width * told.height * len(told.channels) * np.dtype(told.dtype).itemsize
    size = path.stat().st_size
    if promised > size * MOST_GROWTH:
        raise BadInput(f"{path}: promises {promised} bytes of pixels, more than its {size} bytes can become; refused")
    return told


def _check_ends(path: Path) -> None:
    """Raises BadInput if a picture has no end: of a JPEG what is missing would be drawn grey."""
    with opened(path) as file:
        file.seek(max(path.stat().st_size - TAIL_BYTES, 0))
        if ENDS.get(path.suffix.lower(), b"") not in file.read():
            raise BadInput(f"{path}: is truncated, it ends before its picture does; fetch or export it again")


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    oiio = importlib.import_module("OpenImageIO")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # else colours come multiplied by it
    picture = oiio.ImageInput.open(str(path), config)
    if picture is None:
        raise _damaged(path, oiio.geterror())
    try:
        yield picture
    finally:
        picture.close()


def _damaged(path: Path, told: str) -> BadInput:
    reason = " ".join(told.replace(f'"{path}"', "").replace(str(path), "").split()).strip(" :.")
    return BadInput(f"{path}: is truncated or damaged ({reason or 'it cannot be decoded'}); fetch or export it again")


def _rows(path: Path, expected: _Picture, box: Box) -> Voxels:
    """All columns and channels of the box's rows, as (j, i, channel)."""
    with _opened(path) as picture:
        spec = picture.spec()
        if (spec.width, spec.height, spec.nchannels) != (expected.width, expected.height, len(expected.channels)):
            raise BadInput(f"{path}: has changed while it was open; open the volume again")
        rows: Voxels | None = picture.read_scanlines(
            0, 0, box.low[1], box.high[1], 0, 0, spec.nchannels, expected.dtype
        )
        if rows is None:
            raise _damaged(path, picture.geterror())
        return rows.reshape(box.size[1], expected.width, spec.nchannels)


def _colours(picture: _Picture) -> list[str]:
    return [name for name in picture.channels if name != ALPHA]


def _channel(said: ArrayPart, paths: Sequence[Path], picture: _Picture) -> int:
    """The number of the channel that is drawn: the one that is said, or the only one, or one of colours that are equal.

    Whether they are equal in all pictures is found when these are read.
    """
    wanted = said.options.get("channel")
    colours = _colours(picture)
    if wanted is not None:
        if wanted not in picture.channels:
            raise said.wrong("channel", f"names no channel; there are {', '.join(picture.channels)}")
        return picture.channels.index(wanted)
    whole = Box((0, 0, 0), (picture.width, picture.height, 1))
    if len(colours) > 1 and not _are_grey(_rows(paths[len(paths) // 2], picture, whole), picture):
        raise _in_colour(said, paths[len(paths) // 2], picture)
    return picture.channels.index(colours[0])


def _in_colour(said: ArrayPart, path: Path, picture: _Picture) -> BadInput:
    colours = _colours(picture)
    return BadInput(
        f"{said.place}: its pictures are in colour ({', '.join(colours)}; {path.name} for one), volsplat needs one "
        f"number a voxel; choose one, as in {said.advice(f'channel={colours[0]}')}"
    )


def _are_grey(rows: Voxels, picture: _Picture) -> bool:
    """Whether all colours of all pixels are equal, as in grey pictures that a program stored as colour."""
    colours = [n for n, name in enumerate(picture.channels) if name != ALPHA]
    return all(bool((rows[:, :, n] == rows[:, :, colours[0]]).all()) for n in colours[1:])


FOLDER_FORMAT = FolderFormat(
    "pictures", open_picture_folder, lambda folder: slice_kind(visible_files(folder)) == PICTURES
)
