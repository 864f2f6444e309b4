"""What the picture of a volume is called where nobody has said it: as the volume, and never what something else is."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path

from volsplat.client.image.image_file import read_scene
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput

PACKED = (".gz", ".bz2", ".xz", ".zst")  # endings that others stand before
LONGEST_NAME = 200  # bytes; file systems take 255

_WRITTEN: set[Path] = set()


def note_written(path: Path) -> None:
    """This script has written it."""
    _WRITTEN.add(path.absolute())


def unused_picture(volume_path: str | None, name: str) -> Path:
    """A PNG of the working folder. Of the names that are in use only those of earlier scripts' pictures are taken.

    `name` is the volume's, for one that has no path.
    """
    base = _base(volume_path, name)
    for number in count(1):
        path = Path(f"{base}.png" if number == 1 else f"{base}-{number}.png")
        if path.absolute() not in _WRITTEN and (not path.exists() or _is_picture_of_ours(path)):
            return path
    raise AssertionError("numbers do not end")


def _base(volume_path: str | None, name: str) -> str:
    if volume_path is None:
        return _as_file_name(name)
    named = volume_name(volume_path)
    place = Path(named.place)
    if place.suffix in PACKED:
        place = place.with_suffix("")
    return _as_file_name(f"{place.stem}-{named.part.rpartition('/')[2]}" if named.part else place.stem)


def _as_file_name(name: str) -> str:
    plain = re.sub(r"[^\w. -]+", "-", name).strip(". -") or "volume"
    return plain.encode()[:LONGEST_NAME].decode(errors="ignore")


def _is_picture_of_ours(path: Path) -> bool:
    """Whether volsplat wrote it, with its scene."""
    try:
        read_scene(path)
    except BadInput:
        return False
    return True
