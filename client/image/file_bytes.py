"""What a writer of files writes, as bytes: OpenImageIO's Python writes to no memory."""

import tempfile
from collections.abc import Callable
from pathlib import Path


def bytes_of(suffix: str, write: Callable[[Path], object]) -> bytes:
    """The file that `write` makes at the path that it is given, which ends in `suffix`."""
    with tempfile.TemporaryDirectory(prefix="volsplat-") as folder:
        path = Path(folder) / f"file{suffix}"
        write(path)
        return path.read_bytes()
