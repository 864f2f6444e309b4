"""What is written never replaces the volume that is drawn, a file of it, nor anything else that is written with it.

The client does not open volumes, so it goes by what lies in a folder and what a header's file names.
"""

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from volsplat.client.image.header_names import header_names
from volsplat.protocol.description.slice_folders import slice_kind, visible_files
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.open_streams import stream_number

ZARR_MARKS = ("zarr.json", ".zgroup", ".zarray")  # of folders that are a store, also one of packets
HEAD_BYTES = 1 << 18
RECORD_BEGINS = re.compile(rb'\s*(\{\s*"volsplat"|\[\s*(\{"ph"|\]?\s*$))')  # reports, traces


def check_written_apart(volume: str, *written: Path | None, records: Sequence[Path | None] = ()) -> None:
    """Raises BadInput if a file that will be written is one of the volume's, or if two of them are one.

    `records` are reports and traces, and replace nothing else. None is no file, nor is a device.
    """
    name = volume_name(volume)
    place, images, paths = Path(name.plain_place), _files(written), _files([*written, *records])
    if place.is_dir():
        _check_folder(place, name.part, paths)
    else:
        _check_is_not(place, paths)
        _check_is_not_named(place, images)
    for path in _files(records):
        _check_replaces_record(path)
    found: dict[str, Path] = {}
    for path in paths:
        file = os.path.realpath(path)
        if file in found:
            raise BadInput(f"{found[file]}: two things would be written into this file; give each a name of its own")
        found[file] = path


def _check_folder(folder: Path, part: str, paths: Sequence[Path]) -> None:
    if any((folder / mark).exists() for mark in ZARR_MARKS):
        for path in paths:
            if Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
                raise BadInput(f"{path}: would lie in the volume's own store; write into another folder")
    for path in _changing(folder, part, paths):
        raise BadInput(f"{path}: would change the volume, whose folder this is; write into another folder")


def _changing(folder: Path, part: str, paths: Sequence[Path]) -> list[Path]:
    """Which would be slices of the folder, or change of what kind its slices are; `part` says how names begin."""
    inside = [path for path in paths if os.path.realpath(path.parent) == os.path.realpath(folder)]
    try:
        now = visible_files(folder) if inside else []
    except OSError:
        return []  # whoever opens the volume tells why it cannot be read
    kind = slice_kind(now)
    if slice_kind({*now, *(path.name for path in inside if path.name[0] != ".")}) != kind:
        return inside
    first = part.split(",")[0]
    begin = "" if "=" in first else first
    return [path for path in inside if path.name.startswith(begin) and path.name.lower().endswith(kind)]


def _check_is_not(volume: Path, paths: Sequence[Path]) -> None:
    for path in paths:
        if _is_one(path, volume):
            raise BadInput(f"{path}: this is the volume itself; give another name for what is written")


def _check_is_not_named(header: Path, images: Sequence[Path]) -> None:
    there = [path for path in images if path.exists()]
    wanted = {path.name.lower() for path in there}
    named = [name for name in header_names(header) if os.path.basename(name).lower() in wanted] if there else []
    for path in there:
        if any(_is_one(path, header.parent / name) for name in named):
            raise BadInput(f"{path}: {header.name} names this as a file of the volume; give another name")


def _is_one(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except (OSError, ValueError):  # one is not there, or a name that can be none
        return False


def _check_replaces_record(path: Path) -> None:
    """Raises BadInput for a file that holds anything else: raw voxels, of whatever name, or facts of a scan."""
    if not path.is_file():
        return
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return  # who writes it tells why it cannot
    if head and not RECORD_BEGINS.match(head):
        raise BadInput(f"{path}: is there already, and is no report or trace; give another name for what is written")


def _files(paths: Iterable[Path | None]) -> list[Path]:
    """Without what the process has open, which is written on and not replaced, whatever file it leads to."""
    named = [path for path in paths if path is not None and stream_number(path) is None]
    return [path for path in named if path.is_file() or not path.exists()]
