"""Headers that lie beside a file and say that their voxels are in it: people name the one for the other."""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from volsplat.mapshade_server.readers.reading.opened_file import opened

NAMING = (".mhd", ".nhdr")  # of text, with the names of the files that hold the voxels
DATA_FILE = re.compile(rb"\s*(?:ElementDataFile\s*=|data ?file\s*:)", re.IGNORECASE)
LONGEST_HEADER = 1 << 16
MOST_HEADERS = 100  # that are looked into


def header_naming(path: Path) -> Path | None:
    """A header in the file's folder that says that the voxels are in it."""
    name = path.name.encode(errors="surrogateescape")
    return next((header for header in islice(_headers(path), MOST_HEADERS) if name in _named(_text(header))), None)


def _named(text: bytes) -> Iterator[bytes]:
    """The names of the files with a header's voxels, without folders: of one, or on lines of their own."""
    listed = False
    for line in text.splitlines():
        field = DATA_FILE.match(line)
        if field is None and not listed:
            continue
        named = (line[field.end() :] if field else line).strip()
        listed = listed or named.upper().startswith(b"LIST")
        yield re.split(rb"[/\\]", named)[-1]


def _headers(path: Path) -> Iterator[Path]:
    """Those of the same name first."""
    own = [path.with_suffix(extension) for extension in NAMING]
    yield from (header for header in own if header.is_file())
    try:
        found = sorted(one for one in path.parent.iterdir() if one.suffix.lower() in NAMING and one not in own)
    except OSError:  # a folder whose files may be opened need not be open itself
        return
    yield from (header for header in found if header.is_file())


def _text(header: Path) -> bytes:
    try:
        with opened(header) as file:
            return file.read(LONGEST_HEADER)
    except OSError:
        return b""
