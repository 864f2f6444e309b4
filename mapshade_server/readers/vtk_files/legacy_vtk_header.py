"""What VTK's files of before XML say of their grid, and where in them the numbers of each array lie.

Arrays stand between the words that announce them, so all of the file is gone through; numbers are passed over.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote

import numpy as np

from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.vtk_files.vtk_choice import NamedArray
from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

KINDS = ("STRUCTURED_POINTS", "RECTILINEAR_GRID")
LONGEST_LINE = 4096  # of words; numbers may stand in longer ones
READ_BYTES = 1 << 20
COLOUR_TEXT = "colour as text"  # 0 to 1 for 0 to 255; VTK writes all scalars of 8 bits so, where they are text
SCALAR_TYPES = {
    "char": "int8",
    "signed_char": "int8",
    "unsigned_char": "uint8",
    "short": "int16",
    "unsigned_short": "uint16",
    "int": "int32",
    "unsigned_int": "uint32",
    "long": "int64",
    "unsigned_long": "uint64",
    "vtktypeint64": "int64",
    "vtktypeuint64": "uint64",
    "vtkidtype": "int32",  # as VTK writes its indices
    COLOUR_TEXT: "uint8",
    "float": "float32",
    "double": "float64",
}
TEXT_TYPES = ("string", "utf8_string")
# Arrays of so many components, named by the words before their type.
COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


@dataclass
class LegacyArray(NamedArray):
    """`count` values between two places of the file; `scalar_type` is "" for types that are not read."""

    stated_type: str
    count: int
    start: int
    end: int

    @property
    def scalar_type(self) -> str:
        return SCALAR_TYPES.get(self.stated_type.lower(), "")


@dataclass
class LegacyHeader:
    binary: bool
    kind: str = ""
    planes: Index = (0, 0, 0)
    origin: Vector = (0.0, 0.0, 0.0)
    spacing: Vector = (1.0, 1.0, 1.0)
    coordinates: list[LegacyArray] = field(default_factory=list)  # of the planes along x, y, z
    arrays: list[LegacyArray] = field(default_factory=list)
    active: dict[str, str] = field(default_factory=dict)  # the first array announced as scalars, by association


def legacy_header(path: Path) -> LegacyHeader:
    """What the file says. Raises BadInput if it is another data set, damaged or truncated."""
    with opened(path) as file:
        return _Parsing(path, file).run()


class _Parsing:
    """Goes through the file, by the word that each line begins with."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path = path
        self._file = file
        self._size = os.fstat(file.fileno()).st_size
        self._header = LegacyHeader(binary=False)
        self._of = ""  # PointData or CellData, once one is announced
        self._count = 0  # of its values

    def run(self) -> LegacyHeader:
        self._file.readline(LONGEST_LINE)
        self._file.readline(LONGEST_LINE)  # a title
        stored = self._file.readline(LONGEST_LINE).strip().upper()
        if stored not in (b"ASCII", b"BINARY"):
            raise self._damaged(f"its third line is neither ASCII nor BINARY but {stored[:20].decode('latin-1')!r}")
        self._header.binary = stored == b"BINARY"
        try:
            while (words := self._words()) is not None:
                self._take(words)
        except (ValueError, IndexError):
            raise self._damaged(
                f"the line before byte {self._file.tell()} has not the numbers that it should"
            ) from None
        if not self._header.kind or min(self._header.planes) < 1:
            raise self._damaged("it states no data set, or none with points")
        if self._header.kind == "RECTILINEAR_GRID" and len(self._header.coordinates) != 3:
            raise self._damaged("it has not three arrays of coordinates")
        return self._header

    def _words(self) -> list[str] | None:
        """The words of the next line that has any, None at the end."""
        while line := self._file.readline(LONGEST_LINE):
            if words := line.decode("latin-1").split():
                return words
        return None

    def _take(self, words: list[str]) -> None:
        header, word = self._header, words[0].upper()
        match word:
            case "DATASET":
                header.kind = words[1].upper()
                if header.kind not in KINDS:
                    raise BadInput(
                        f"{self._path}: holds VTK's {words[1]}, volsplat reads {' and '.join(KINDS)}; "
                        "resample it to an image"
                    )
            case "DIMENSIONS":
                header.planes = (int(words[1]), int(words[2]), int(words[3]))
            case "ORIGIN":
                header.origin = (float(words[1]), float(words[2]), float(words[3]))
            case "SPACING" | "ASPECT_RATIO":
                header.spacing = (float(words[1]), float(words[2]), float(words[3]))
            case "X_COORDINATES" | "Y_COORDINATES" | "Z_COORDINATES":
                axis = "XYZ".index(word[0])
                if int(words[1]) != header.planes[axis] or len(header.coordinates) != axis:
                    raise self._damaged(f"{words[0]} are {words[1]}, but its dimensions {header.planes}")
                header.coordinates.append(self._passed(words[0], words[2], 1, int(words[1])))
            case "POINT_DATA" | "CELL_DATA":
                self._of = "PointData" if word == "POINT_DATA" else "CellData"
                self._count = int(words[1])
            case "SCALARS":
                self._scalars(words)
            case "COLOR_SCALARS":
                if int(words[2]) == 1:
                    header.active.setdefault(self._of, unquote(words[1]))
                self._add(words[1], self._colour_type, int(words[2]), self._count)
            case "LOOKUP_TABLE":
                self._passed(words[1], self._colour_type, 4, int(words[2]))
            case "TEXTURE_COORDINATES":
                self._add(words[1], words[3], int(words[2]), self._count)
            case "FIELD":
                self._field(words)
            case "METADATA":
                self._pass_metadata()
            case _ if word in COMPONENTS:
                self._add(words[1], words[2], COMPONENTS[word], self._count)
            case _:
                raise self._damaged(f"“{words[0][:20]}” at byte {self._file.tell()} is no word of this format")

    @property
    def _colour_type(self) -> str:
        return "unsigned_char" if self._header.binary else COLOUR_TEXT

    def _scalars(self, words: list[str]) -> None:
        components = int(words[3]) if len(words) > 3 else 1
        before = self._file.tell()
        following = self._words()
        if following is None or following[0].upper() != "LOOKUP_TABLE":
            self._file.seek(before)  # which old files leave out
        name = unquote(words[1])
        if components == 1:
            self._header.active.setdefault(self._of, name)
        self._add(name, words[2], components, self._count)

    def _field(self, words: list[str]) -> None:
        """Arrays, each announced by name, components, values and type; only those of points or cells are kept."""
        left = int(words[2])
        while left > 0 and (said := self._words()) is not None:
            if said[0].upper() == "METADATA":
                self._pass_metadata()
                continue
            left -= 1
            if self._of:
                self._add(said[0], said[3], int(said[1]), int(said[2]))
            else:
                self._passed(said[0], said[3], int(said[1]), int(said[2]))

    def _pass_metadata(self) -> None:
        while self._file.readline(LONGEST_LINE).strip():
            pass

    def _add(self, name: str, stated_type: str, components: int, count: int) -> None:
        array = self._passed(unquote(name), stated_type, components, count)
        if stated_type.lower() not in TEXT_TYPES:
            self._header.arrays.append(array)

    def _passed(self, name: str, stated_type: str, components: int, count: int) -> LegacyArray:
        """The array that begins here; its numbers are passed over. Raises BadInput if they are not all there."""
        start, numbers = self._file.tell(), components * count
        if numbers < 0 or numbers > 8 * self._size:
            raise self._damaged(f"{name} states {count} values of {components} numbers")
        if stated_type.lower() in TEXT_TYPES:
            self._pass_strings(name, numbers)
        elif self._header.binary:
            self._file.seek(self._bytes(name, stated_type, numbers), os.SEEK_CUR)
        else:
            self._pass_text(name, numbers)
        end = self._file.tell()
        if end > self._size:
            raise self._damaged(f"{name} states {end - start} bytes, but {max(self._size - start, 0)} follow")
        return LegacyArray(name, components, self._of == "CellData", stated_type, count, start, end)

    def _bytes(self, name: str, stated_type: str, numbers: int) -> int:
        kind = stated_type.lower()
        if kind == "bit":
            return -(-numbers // 8)
        if kind not in SCALAR_TYPES:
            raise BadInput(f"{self._path}: {name} is of type {stated_type}, of unknown length; save it without that")
        return numbers * np.dtype(SCALAR_TYPES[kind]).itemsize

    def _pass_strings(self, name: str, strings: int) -> None:
        """Goes on behind so many strings: each a line, or its length and its bytes."""
        for n in range(strings):
            head = self._file.read(1) if self._header.binary else self._file.readline()
            if not head:
                raise self._damaged(f"{name} states {strings} strings, but {n} follow")
            if self._header.binary:
                # The length is big endian; its first two bits tell of how many bytes it is.
                more = (8, 4, 2, 1)[head[0] >> 6] - 1
                length = int.from_bytes(bytes([head[0] & 0x3F]) + self._file.read(more))
                self._file.seek(min(length, self._size), os.SEEK_CUR)

    def _pass_text(self, name: str, numbers: int) -> None:
        """Goes on behind so many words, which end with a line."""
        left, inside = numbers, False
        while left > 0:
            at = self._file.tell()
            chunk = self._file.read(READ_BYTES)
            if not chunk:
                raise self._damaged(f"{name} states {numbers} numbers, but {numbers - left} follow")
            # A word that goes on from the chunk before has been counted there.
            count = len(chunk.split()) - (inside and not chunk[:1].isspace())
            if count >= left:
                self._file.seek(at)
                while left > 0 and (line := self._file.readline()):
                    left -= len(line.split()) - (inside and not line[:1].isspace())
                    inside = False
                return
            left -= count
            inside = not chunk[-1:].isspace()

    def _damaged(self, why: str) -> BadInput:
        return BadInput(f"{self._path}: {why}; the file is truncated or damaged, save or fetch it again")
