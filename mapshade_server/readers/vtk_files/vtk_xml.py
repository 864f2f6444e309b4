"""The XML of VTK's grids (.vti, .vtr): what it says of the grid and of its arrays, without the numbers of these.

If arrays are appended, it is read no further than to them. A document type declaration, the door of entity bombs,
is refused.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.vtk_files.vtk_choice import NamedArray
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import printable

GRIDS = ("ImageData", "RectilinearGrid")
NAMES_FILE = ("file", "Source")  # attributes by which a file of others names them
READ = (".vti", ".vtr")
IN_PIECES = {"PImageData": ".vti", "PRectilinearGrid": ".vtr"}  # each a part of one grid, and what that is saved as
ARRAYS_IN = ("PointData", "CellData", "Coordinates")
PARSED_CHUNK = 1 << 16
SCALAR_TYPES = {
    **{f"{sign}Int{bits}": f"{sign.lower()}int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "Float32": "float32",
    "Float64": "float64",
}
LONGEST_TAG = 4096  # of the element of appended data

Attributes = dict[str, str]


@dataclass
class VtkElement(NamedArray):
    """An array, and where the text in it starts and ends in the file; -1 without text."""

    attributes: Attributes
    start: int = -1
    end: int = -1

    @property
    def scalar_type(self) -> str:
        return SCALAR_TYPES.get(self.attributes.get("type", ""), "")


@dataclass
class VtkXml:
    """What the XML says of the grid; `active` has the names of the scalars that VTK takes, by what they are of."""

    file: Attributes = field(default_factory=dict)
    grid: Attributes = field(default_factory=dict)
    pieces: list[Attributes] = field(default_factory=list)
    active: dict[str, str] = field(default_factory=dict)
    arrays: list[VtkElement] = field(default_factory=list)
    coordinates: list[VtkElement] = field(default_factory=list)
    names: list[str] = field(default_factory=list)  # of other files
    appended: Attributes | None = None
    appended_start: int = -1  # of the first byte behind the `_`


class _AppendedReached(Exception):
    """Ends the parsing: what follows is not XML."""


class _Parsing:
    """expat's handlers, which fill a VtkXml."""

    def __init__(self, path: Path) -> None:
        self.xml = VtkXml()
        self._path = path
        self._inside: list[str] = []
        self._array = VtkElement("", 0, False, {})  # the last one
        self._text_of: VtkElement | None = None  # whose numbers are being passed
        self._parser = expat.ParserCreate()
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text

    def run(self) -> VtkXml:
        try:
            with opened(self._path) as file:
                while chunk := file.read(PARSED_CHUNK):
                    self._parser.Parse(chunk, False)
            self._parser.Parse(b"", True)
        except _AppendedReached:
            self._find_appended()
        except expat.ExpatError as error:
            raise BadInput(f"{self._path}: its XML is truncated or damaged ({error}); save or fetch it again") from None
        return self.xml

    def _doctype(self, *_: Any) -> None:
        raise BadInput(f"{self._path}: has a document type declaration, which no file of VTK's needs; it is not read")

    def _start(self, name: str, attributes: Attributes) -> None:
        self._end_of_text()
        inside = self._inside[-1] if self._inside else ""
        if name == "AppendedData":
            self.xml.appended = attributes
            self.xml.appended_start = self._parser.CurrentByteIndex
            raise _AppendedReached
        self.xml.names += (attributes[key] for key in NAMES_FILE if key in attributes)
        if not inside:
            self.xml.file = attributes
        elif name == "Piece":
            self.xml.pieces.append(attributes)
        elif name in ARRAYS_IN:
            self.xml.active[name] = attributes.get("Scalars", "")
        elif inside in ARRAYS_IN:
            stated = attributes.get("NumberOfComponents", "1")
            components = int(stated) if stated.isdecimal() else 0
            self._array = VtkElement(attributes.get("Name", ""), components, inside == "CellData", attributes)
            if name == "DataArray":  # the others hold text
                (self.xml.coordinates if inside == "Coordinates" else self.xml.arrays).append(self._array)
        elif inside == "VTKFile":
            self.xml.grid = attributes
        self._inside.append(name)

    def _text(self, text: str) -> None:
        in_array = len(self._inside) > 1 and self._inside[-2] in ARRAYS_IN
        if self._text_of is None and in_array and not text.isspace():
            self._text_of = self._array
            if self._text_of.start < 0:
                self._text_of.start = self._parser.CurrentByteIndex

    def _end(self, name: str) -> None:
        self._end_of_text()
        self._inside.pop()

    def _end_of_text(self) -> None:
        if self._text_of is not None and self._text_of.end < 0:
            self._text_of.end = self._parser.CurrentByteIndex
        self._text_of = None

    def _find_appended(self) -> None:
        with opened(self._path) as file:
            file.seek(self.xml.appended_start)
            match = re.match(rb"<[^>]*>\s*_", file.read(LONGEST_TAG))
        if match is None:
            raise BadInput(f"{self._path}: its appended data has no beginning; save or fetch the file again")
        self.xml.appended_start += match.end()


def _listing(path: Path, kind: str, images: Sequence[str]) -> str:
    """What a list of files is, and what to give in its place."""
    first = printable(str(path.parent / images[0]))
    if len(images) == 1:
        return f"a list of 1 file; give it: {first}"
    if kind in IN_PIECES:
        return f"one grid in {len(images)} files; save it as one {IN_PIECES[kind]}, as ParaView does"
    return f"a list of {len(images)} files; give one of them, as {first}"


def vtk_xml(path: Path) -> VtkXml:
    """What the XML says. Raises BadInput if it is damaged or describes no image or grid in one piece."""
    xml = _Parsing(path).run()
    kind = xml.file.get("type", "")
    images = [name for name in xml.names if name.lower().endswith(READ)]
    if kind not in GRIDS and images:
        raise BadInput(f"{path}: holds VTK's {printable(kind)}, {_listing(path, kind, images)}")
    if kind not in GRIDS:
        raise BadInput(f"{path}: holds VTK's {kind or 'nothing'}, volsplat reads ImageData; resample it to an image")
    stated = [xml.grid.get("WholeExtent", ""), *(piece.get("Extent", "") for piece in xml.pieces)]
    extents = [" ".join(extent.split()) for extent in stated]
    if len(set(extents)) != 1 or len(xml.pieces) != 1:
        raise BadInput(f"{path}: its grid of {extents[0]} is in pieces ({', '.join(extents[1:])}); save it as one")
    return xml
