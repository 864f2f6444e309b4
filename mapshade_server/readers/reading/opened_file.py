"""Opens files of which a reader wants the head, or pieces here and there."""

from io import BufferedReader
from pathlib import Path

READ_AHEAD = 4096  # bytes, of which headers take few; open() would read 128 KiB ahead from Python 3.14 on


def opened(path: Path) -> BufferedReader:
    """From its first byte on. Raises OSError."""
    file = path.open("rb", buffering=READ_AHEAD)
    assert isinstance(file, BufferedReader)
    return file
