"""Files of text that are read whole, plain or gzip, within a limit: a small file may unpack to more than memory."""

import gzip
import zlib
from pathlib import Path

from volsplat.mapshade_server.readers.reading.gzip_files import is_gzip
from volsplat.protocol.text.errors import BadInput

MOST_BYTES = 1 << 30
CHUNK_BYTES = 1 << 20
MOST_GROWTH = 50  # of text; the densest packed coordinates grow tenfold


def unzipped_text(path: Path) -> str:
    """The file's text, ? for each byte that is not ASCII, so that columns stay where they are.

    Raises BadInput where it is damaged, or unpacks to more than a text would.
    """
    packed = is_gzip(path)
    size = path.stat().st_size
    most = min(MOST_BYTES, MOST_GROWTH * size + CHUNK_BYTES) if packed else MOST_BYTES
    chunks: list[bytes] = []
    with gzip.open(path) if packed else path.open("rb") as stream:
        try:
            while chunk := stream.read(CHUNK_BYTES):
                chunks.append(chunk)
                if sum(map(len, chunks)) > most:
                    raise BadInput(
                        f"{path}: is more than {most} bytes of text{' unpacked' if packed else ''}, "
                        "too much for a molecule; check what it is"
                    )
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise BadInput(f"{path}: its gzip data is damaged or truncated; fetch the file again") from None
    return b"".join(chunks).decode("ascii", "replace").replace("\ufffd", "?")
