"""The header of an NRRD file: its fields by their names, and the numbers and vectors in them."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

from volsplat.mapshade_server.readers.reading.header_numbers import whole_numbers
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

LONGEST_HEADER = 1 << 20
LONGEST_LINE = 1 << 16

_NAMES = (
    "content,number,type,block size,dimension,space,space dimension,sizes,spacings,thicknesses,axis mins,axis maxs,"
    "space directions,centers,kinds,labels,units,min,max,old min,old max,data file,endian,encoding,line skip,byte skip,"
    "sample units,space units,space origin,measurement frame"
).split(",")
# The format's fields by all of their spellings, in lower case.
FIELDS = {"centerings": "centers", **{spelt: name for name in _NAMES for spelt in (name, name.replace(" ", ""))}}


@dataclass(frozen=True)
class NrrdHeader:
    """The fields by their lower-case names, and where the header ends in the file."""

    path: Path
    fields: dict[str, str]
    pairs: dict[str, str]  # of keys and values, which mean something to those who wrote them
    file_list: tuple[str, ...]
    end: int

    def wrong(self, name: str, why: str) -> BadInput:
        return BadInput(f'{self.path}: the header\'s "{name}: {self.fields.get(name, "")}" {why}; correct the header')

    def quoted(self, name: str) -> list[str]:
        """The texts between quotation marks, none if the field is not there."""
        return re.findall(r'"([^"]*)"', self.fields.get(name, ""))

    def integers(self, name: str) -> tuple[int, ...]:
        try:
            return whole_numbers(self.fields.get(name, "").split())
        except ValueError as error:
            raise self.wrong(name, str(error)) from None

    def numbers(self, name: str, count: int) -> list[float]:
        try:
            values = [float(word) for word in self.fields[name].split()]
        except ValueError:
            raise self.wrong(name, "is not a list of numbers") from None
        if len(values) != count:
            raise self.wrong(name, f"should have {count} values")
        return values

    def vectors(self, name: str) -> list[Vector | None]:
        """Vectors of three components, or None for an axis that leads nowhere in space: none, or along time only."""
        found: list[Vector | None] = []
        for match in re.finditer(r"none|\(([^()]*)\)", self.fields[name]):
            try:
                values = [float(word) for word in (match[1] or "").split(",") if word.strip()]
            except ValueError:
                raise self.wrong(name, "is not a list of vectors") from None
            nowhere = match[0] == "none" or all(math.isnan(value) for value in values)
            if nowhere or len(values) > 3 and not any(values[:3]) and any(values[3:]):
                found.append(None)
            elif len(values) < 3 or any(values[3:]):
                raise self.wrong(name, "should have three components in each vector")
            else:
                found.append((values[0], values[1], values[2]))
        return found


def header_of_file(path: Path) -> NrrdHeader:
    """The header of a file that begins as NRRD does. Raises BadInput if it does not end."""
    fields: dict[str, str] = {}
    pairs: dict[str, str] = {}
    file_list: list[str] = []
    with opened(path) as file:
        file.readline(LONGEST_LINE)  # the magic, which was recognised
        while (line := file.readline(LONGEST_LINE)).strip():
            text = line.decode("utf-8", "replace").strip()
            if fields.get("data file", "").upper().startswith("LIST"):
                file_list.append(text)
            elif not text.startswith("#"):
                _take(text, fields, pairs)
            if file.tell() > LONGEST_HEADER:
                raise BadInput(f"{path}: the NRRD header does not end; correct the file")
        return NrrdHeader(path, fields, pairs, tuple(file_list), file.tell())


def _take(line: str, fields: dict[str, str], pairs: dict[str, str]) -> None:
    """Add what a line states: one of the format's fields before ": ", else a key before ":=", which may have colons."""
    name, colon, value = line.partition(": ")
    if not colon or name.strip().lower() not in FIELDS:
        key, equals, text = line.partition(":=")
        if equals:
            pairs[_unescaped(key)] = _unescaped(text)
            return
        name, colon, value = line.partition(":")  # some leave out the blank
    if colon:
        name = name.strip().lower()
        fields[FIELDS.get(name, name)] = value.strip()


def _unescaped(text: str) -> str:
    """With newlines and backslashes of a key or value, which stand in its line as \\n and \\\\; any other is itself."""
    return re.sub(r"\\([n\\])", lambda match: "\n" if match[1] == "n" else "\\", text)
