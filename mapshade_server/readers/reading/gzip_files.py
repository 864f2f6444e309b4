"""Files that gzip has compressed as a whole: which are, and what they begin with."""

import gzip
import zlib
from pathlib import Path

from volsplat.protocol.text.errors import BadInput

GZIP_MAGIC = b"\x1f\x8b"


def is_gzip(path: Path) -> bool:
    """Whether the file is compressed, whatever its name says."""
    with path.open("rb") as file:
        return file.read(len(GZIP_MAGIC)) == GZIP_MAGIC


def first_bytes(path: Path, count: int) -> bytes:
    """The file's first bytes, unzipped where it is gzip. Raises BadInput where it cannot be unzipped."""
    opened = gzip.open(path) if is_gzip(path) else path.open("rb")
    with opened as file:
        try:
            return file.read(count)
        except (OSError, EOFError, zlib.error):
            raise BadInput(f"{path}: its gzip data is damaged or truncated; fetch the file again") from None
