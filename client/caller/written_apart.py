"""What is written never replaces the file that is drawn, nor anything else that is written with it."""

import os
from itertools import combinations
from pathlib import Path

from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput


def check_written_apart(volume: str, *written: Path | None) -> None:
    """Raises BadInput if a file that will be written is the volume, or if two of them are one.

    None is no file, nor is a device. A volume's other files, as those of a folder, are not known here.
    """
    place, paths = Path(volume_name(volume).place), [path for path in written if path is not None and _is_file(path)]
    for path in paths:
        if path.exists() and place.exists() and path.samefile(place):
            raise BadInput(f"{path}: this is the volume itself; give another name for what is written")
    for one, other in combinations(paths, 2):
        if os.path.realpath(one) == os.path.realpath(other):
            raise BadInput(f"{one}: two things would be written into this file; give each a name of its own")


def _is_file(path: Path) -> bool:
    return path.is_file() or not path.exists()
