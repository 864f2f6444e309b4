"""The files that a volume's header names: NRRD and MetaImage, whose voxels may lie beside it, and sets of OME-TIFF.

Headers alone are searched, and for whole names, since among voxels any bytes may stand.
"""

import html
import os
import re
import struct
from pathlib import Path
from typing import BinaryIO

LONGEST_TEXT = 1 << 20
LONGEST_XML = 1 << 25  # a set of 6000 files has 0.8 MB
HEADERS = re.compile(rb"NRRD000.*?(?:\n[ \t\r]*\n|\Z)|[^\0]*?\bElementDataFile\s*=(?:\s*LIST.*|[^\n]*)", re.DOTALL)
NAME_OF_LINE = re.compile(rb"^(?:data ?file *:|ElementDataFile *=)?[ \t]*(.*?)[ \t\r]*$", re.MULTILINE | re.IGNORECASE)
NAME_IN_XML = re.compile(rb"""\b(?:FileName|MetadataFile)\s*=\s*(["'])(.*?)\1""")
TIFF_TAGS = {b"II*\0": "<HHII", b"MM\0*": ">HHII", b"II+\0": "<HHQQ", b"MM\0+": ">HHQQ"}  # tag, type, count, place
DESCRIPTION = 270  # the tag


def header_names(header: Path) -> list[str]:
    """As they stand there: relative to the header's folder. A line of text may be one. None of what cannot be read."""
    try:
        if not header.is_file():  # to open a FIFO is to wait for who writes it
            return []
        with header.open("rb") as file:
            start = file.read(16)
            if tag := TIFF_TAGS.get(start[:4]):
                xml = _description(file, start, tag)
                return [html.unescape(os.fsdecode(name)) for _, name in NAME_IN_XML.findall(xml)]
            text = HEADERS.match(start + file.read(LONGEST_TEXT))
            return [os.fsdecode(name) for name in NAME_OF_LINE.findall(text[0])] if text else []
    except (OSError, OverflowError, struct.error):  # whoever opens the volume tells why it cannot be read
        return []


def _description(file: BinaryIO, start: bytes, tag: str) -> bytes:
    """What a TIFF says of its first page, where OME-XML stands."""
    many, offset = (tag[0] + "H", tag[0] + "I") if tag.endswith("I") else (tag[0] + "Q", tag[0] + "Q")
    file.seek(*struct.unpack_from(offset, start, struct.calcsize(offset)))
    (count,) = struct.unpack(many, file.read(struct.calcsize(many)))
    tags = file.read(min(count, 1 << 16) * struct.calcsize(tag))
    for number, _, length, place in struct.iter_unpack(tag, tags):
        if number == DESCRIPTION:
            file.seek(place)
            return file.read(min(length, LONGEST_XML))
    return b""
