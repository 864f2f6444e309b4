"""What is written never replaces the volume that is drawn, a file of it, nor anything else that is written with it.

The client does not open volumes, so it goes by what lies in a folder and what a header's file names.
"""

import os
from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path

from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.open_streams import stream_number

SLICE_KINDS = ((".png", ".jpg", ".jpeg"), (".tif", ".tiff"))  # of folders whose pictures are slices
ZARR_MARKS = ("zarr.json", ".zgroup", ".zarray")  # of folders that are a store, also one of packets
HEADER_BYTES = 1 << 18  # at the file's beginning and at its end: a TIFF's description may be at either
JSON_BEGINS = (b"{", b"[")


def check_written_apart(volume: str, *written: Path | None, records: Sequence[Path | None] = ()) -> None:
    """Raises BadInput if a file that will be written is one of the volume's, or if two of them are one.

    `records` are written as JSON, and replace nothing else. None is no file, nor is a device.
    """
    name = volume_name(volume)
    place, paths = Path(name.place), _files([*written, *records])
    for path in paths:
        _check_is_not_of(place, name.part, path)
    for path in _files(records):
        check_replaces_json(path)
    for one, other in combinations(paths, 2):
        if os.path.realpath(one) == os.path.realpath(other):
            raise BadInput(f"{one}: two things would be written into this file; give each a name of its own")


def check_replaces_json(path: Path) -> None:
    """Raises BadInput for a file that holds anything else: raw voxels may have any name."""
    if not path.is_file():
        return
    try:
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES).lstrip()
    except OSError:
        return  # who writes it tells why it cannot
    if head and not head.startswith(JSON_BEGINS):
        raise BadInput(f"{path}: is there already and holds no JSON; give another name for what is written")


def _check_is_not_of(place: Path, part: str, path: Path) -> None:
    if place.is_dir():
        if any((place / mark).exists() for mark in ZARR_MARKS) and _lies_in(place, path):
            raise BadInput(f"{path}: would lie in the volume's own store; write into another folder")
        if _is_slice(place, part, path):
            raise BadInput(f"{path}: would be a slice of the volume, whose folder this is; write into another folder")
    elif path.exists() and place.exists():
        if path.samefile(place):
            raise BadInput(f"{path}: this is the volume itself; give another name for what is written")
        if place.is_file() and _names(place, path.name):
            raise BadInput(f"{path}: {place.name} names this as a file of the volume; give another name")


def _lies_in(folder: Path, path: Path) -> bool:
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def _is_slice(folder: Path, part: str, path: Path) -> bool:
    """Whether a file would be read with the folder's pictures: `part` says how the names of those begin."""
    kinds = next((kinds for kinds in SLICE_KINDS if path.suffix.lower() in kinds), None)
    first = part.split(",")[0]
    begin = "" if "=" in first else first
    if kinds is None or not path.name.startswith(begin) or os.path.realpath(path.parent) != os.path.realpath(folder):
        return False
    try:
        names = [other.name.lower() for other in folder.iterdir() if other.name[0] != "." and not other.is_dir()]
    except OSError:
        return False  # as below
    return 0 < len(names) <= 2 * sum(name.endswith(kinds) for name in names)


def _names(header: Path, name: str) -> bool:
    try:
        with header.open("rb") as file:
            head = file.read(HEADER_BYTES)
            file.seek(max(header.stat().st_size - HEADER_BYTES, 0))
            return os.fsencode(name) in head or os.fsencode(name) in file.read()
    except OSError:
        return False  # whoever opens the volume tells why it cannot be read


def _files(paths: Iterable[Path | None]) -> list[Path]:
    """Without what the process has open, which is written on and not replaced, whatever file it leads to."""
    named = [path for path in paths if path is not None and stream_number(path) is None]
    return [path for path in named if path.is_file() or not path.exists()]
