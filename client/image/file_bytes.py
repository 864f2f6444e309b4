"""What a writer of files writes, as bytes: OpenImageIO's Python writes to no memory."""

from collections.abc import Callable
from pathlib import Path

from volsplat.program.temporary_folder import temporary_folder


def bytes_of(suffix: str, write: Callable[[Path], object]) -> bytes:
    """The file that `write` makes at the path that it is given, which ends in `suffix`."""
    with temporary_folder() as folder:
        path = folder / f"file{suffix}"
        write(path)
        return path.read_bytes()
