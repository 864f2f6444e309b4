"""What the picture of a volume is called where nobody has said it: as the volume, and never what something else is."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path

from volsplat.client.image.image_file import read_scene
from volsplat.client.script.rendered_image import RenderedImage
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput

PACKED = (".gz", ".bz2", ".xz", ".zst")  # endings that others stand before

_GIVEN: set[Path] = set()


def unused_picture(image: RenderedImage) -> Path:
    """A PNG of the working folder. Of the names that are in use only those of earlier scripts' pictures are taken."""
    name = _name_of(image)
    for number in count(1):
        path = Path(f"{name}.png" if number == 1 else f"{name}-{number}.png")
        if path.absolute() not in _GIVEN and (not path.exists() or _is_picture_of_ours(path)):
            _GIVEN.add(path.absolute())
            return path
    raise AssertionError("numbers do not end")


def _name_of(image: RenderedImage) -> str:
    if image.volume_path is None:
        return _as_file_name(image.volume_name)
    named = volume_name(image.volume_path)
    place = Path(named.place)
    if place.suffix in PACKED:
        place = place.with_suffix("")
    return _as_file_name(f"{place.stem}-{named.part.rpartition('/')[2]}" if named.part else place.stem)


def _as_file_name(name: str) -> str:
    return re.sub(r"[^\w. -]+", "-", name).strip(". -") or "volume"


def _is_picture_of_ours(path: Path) -> bool:
    """Whether volsplat wrote it, with its scene."""
    try:
        read_scene(path)
    except BadInput:
        return False
    return True
