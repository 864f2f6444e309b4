"""Files that gzip has compressed as a whole, or not: read alike, within limits."""

import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedIOBase
from pathlib import Path

from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.protocol.text.errors import BadInput

GZIP_MAGIC = b"\x1f\x8b"
DAMAGED_GZIP = "its gzip data is damaged or truncated; fetch the file again"
MOST_TEXT_BYTES, TEXT_CHUNK_BYTES = 1 << 30, 1 << 20
MOST_GROWTH_OF_TEXT = 50  # the densest packed coordinates grow tenfold


def is_gzip(path: Path) -> bool:
    """Whether the file is compressed, whatever its name says."""
    with opened(path) as file:
        return file.read(len(GZIP_MAGIC)) == GZIP_MAGIC


@contextmanager
def unzipped(path: Path) -> Iterator[BufferedIOBase]:
    """The file's bytes, unzipped if it is gzip. Raises BadInput if it cannot be unzipped."""
    with gzip.open(path) if is_gzip(path) else opened(path) as file:
        try:
            yield file
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise BadInput(f"{path}: {DAMAGED_GZIP}") from None


def first_bytes(path: Path, count: int) -> bytes:
    """The file's first bytes. Raises BadInput if they cannot be unzipped."""
    with unzipped(path) as file:
        return file.read(count)


def unzipped_text(path: Path) -> str:
    """The text of a file that is read whole, ? for each byte that is not ASCII, so that columns stay in place.

    Raises BadInput if it is damaged, or unpacks to more than a text would: a small file may become more than memory.
    """
    packed = is_gzip(path)
    most = MOST_TEXT_BYTES
    if packed:
        most = min(most, MOST_GROWTH_OF_TEXT * path.stat().st_size + TEXT_CHUNK_BYTES)
    chunks: list[bytes] = []
    with unzipped(path) as file:
        while chunk := file.read(TEXT_CHUNK_BYTES):
            chunks.append(chunk)
            if sum(map(len, chunks)) > most:
                raise BadInput(
                    f"{path}: is more than {most} bytes of text{' unpacked' if packed else ''}, "
                    "too much for a molecule; check what it is"
                )
    return b"".join(chunks).decode("ascii", "replace").replace("\ufffd", "?")
