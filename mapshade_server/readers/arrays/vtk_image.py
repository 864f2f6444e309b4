"""VTK's ImageData as XML (.vti): the array of its points that the name's part names, or its only or active one.

The XML is read without keeping the numbers in it and, where these are appended, no further than to them. A document
type declaration, the door of entity bombs, is refused.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from xml.parsers import expat

import numpy as np

from volsplat.mapshade_server.readers.arrays.vtk_arrays import (
    COMPRESSORS,
    Base64Voxels,
    BlockVoxels,
    BoxesOfVoxels,
    TextVoxels,
    VtkArray,
    stored_voxels,
)
from volsplat.mapshade_server.readers.simple_itk import checked_geometry
from volsplat.mapshade_server.readers.volume_reader import OpenedVolume
from volsplat.protocol.errors import BadInput
from volsplat.protocol.matrices import Matrix, applied, plus
from volsplat.protocol.volume import Geometry, VolumeDescription

SCALAR_TYPES = {
    **{f"{sign}Int{bits}": f"{sign.lower()}int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "Float32": "float32",
    "Float64": "float64",
}
LENGTH_TYPES = {"UInt32": "u4", "UInt64": "u8"}
BYTE_ORDERS: dict[str, Literal["<", ">"]] = {"LittleEndian": "<", "BigEndian": ">"}
PARSED_CHUNK = 1 << 16
LONGEST_TAG = 4096  # of the element of appended data

Attributes = dict[str, str]


def recognises(head: bytes) -> bool:
    return b"<VTKFile" in head and head.lstrip(b"\xef\xbb\xbf \r\n\t").startswith((b"<?xml", b"<VTKFile", b"<!"))


def open_vtk_image(path: Path, part: str) -> OpenedVolume:
    """The reader for a .vti. Raises BadInput where it has no array of one number a point or another must be chosen."""
    xml = _xml(path)
    geometry = _geometry(path, xml)
    element = _chosen(path, part, xml)
    scalar_type = SCALAR_TYPES.get(element.attributes.get("type", ""))
    if scalar_type is None:
        raise _wrong(path, element.attributes, "type", "is no type of number that volsplat reads")
    voxels, why_whole = _voxels(path, xml, element, geometry, scalar_type)
    description = VolumeDescription(
        name=path.name,
        format="VTK image",
        geometry=geometry,
        scalar_type=scalar_type,
        density_name=element.name or "density",
        reads_sub_cubes=not why_whole,
        why_whole=why_whole,
    )
    return OpenedVolume(description, voxels.read)


@dataclass
class _Element:
    """An array of the points, and where the text in it starts and ends in the file; -1 without text."""

    attributes: Attributes
    start: int = -1
    end: int = -1

    @property
    def name(self) -> str:
        return self.attributes.get("Name", "")

    @property
    def components(self) -> str:
        return self.attributes.get("NumberOfComponents", "1")


@dataclass
class _Xml:
    """What the XML says of the image."""

    file: Attributes = field(default_factory=dict)
    image: Attributes = field(default_factory=dict)
    pieces: list[Attributes] = field(default_factory=list)
    points: Attributes = field(default_factory=dict)
    arrays: list[_Element] = field(default_factory=list)
    cell_arrays: int = 0
    appended: Attributes | None = None
    appended_start: int = -1  # of the first byte behind the `_`


class _AppendedReached(Exception):
    """Ends the parsing: what follows is not XML."""


class _Parsing:
    """expat's handlers, which fill an _Xml."""

    def __init__(self, path: Path) -> None:
        self.xml = _Xml()
        self._path = path
        self._inside: list[str] = []
        self._text_of: _Element | None = None  # whose numbers are being passed
        self._parser = expat.ParserCreate()
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text

    def run(self) -> _Xml:
        try:
            with self._path.open("rb") as file:
                while chunk := file.read(PARSED_CHUNK):
                    self._parser.Parse(chunk, False)
            self._parser.Parse(b"", True)
        except _AppendedReached:
            self._find_appended()
        except expat.ExpatError as error:
            raise BadInput(f"{self._path}: its XML is truncated or damaged ({error}); save or fetch it again") from None
        return self.xml

    def _doctype(self, *_: Any) -> None:
        raise BadInput(f"{self._path}: has a document type declaration, which no .vti needs; it is not read")

    def _start(self, name: str, attributes: Attributes) -> None:
        self._end_of_text()
        inside = self._inside[-1] if self._inside else ""
        if name == "AppendedData":
            self.xml.appended = attributes
            self.xml.appended_start = self._parser.CurrentByteIndex
            raise _AppendedReached
        if not inside:
            self.xml.file = attributes
        elif name == "Piece":
            self.xml.pieces.append(attributes)
        elif name == "PointData":
            self.xml.points = attributes
        elif inside == "PointData":
            self.xml.arrays.append(_Element(attributes))
        elif inside == "CellData":
            self.xml.cell_arrays += 1
        elif inside == "VTKFile":
            self.xml.image = attributes
        self._inside.append(name)

    def _text(self, text: str) -> None:
        if self._text_of is None and self._inside[-2:-1] == ["PointData"] and not text.isspace():
            self._text_of = self.xml.arrays[-1]
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
        with self._path.open("rb") as file:
            file.seek(self.xml.appended_start)
            match = re.match(rb"<[^>]*>\s*_", file.read(LONGEST_TAG))
        if match is None:
            raise BadInput(f"{self._path}: its appended data has no beginning; save or fetch the file again")
        self.xml.appended_start += match.end()


def _xml(path: Path) -> _Xml:
    """What the XML says. Raises BadInput where it is damaged or tells of no image in one piece."""
    xml = _Parsing(path).run()
    kind = xml.file.get("type", "")
    if kind != "ImageData":
        raise BadInput(f"{path}: holds VTK's {kind or 'nothing'}, volsplat reads ImageData; resample it to an image")
    stated = [xml.image.get("WholeExtent", ""), *(piece.get("Extent", "") for piece in xml.pieces)]
    extents = [" ".join(extent.split()) for extent in stated]
    if len(set(extents)) != 1 or len(xml.pieces) != 1:
        raise BadInput(f"{path}: its image of {extents[0]} is in pieces ({', '.join(extents[1:])}); save it as one")
    return xml


def _wrong(path: Path, attributes: Attributes, name: str, why: str) -> BadInput:
    return BadInput(f'{path}: {name}="{attributes.get(name, "")}" {why}; correct the file')


def _geometry(path: Path, xml: _Xml) -> Geometry:
    """The image's grid. Origin is the place of index 0, whether or not the extent holds that."""
    i0, i1, j0, j1, k0, k1 = (int(number) for number in _numbers(path, xml.image, "WholeExtent", "0 -1 0 -1 0 -1"))
    dims = (i1 - i0 + 1, j1 - j0 + 1, k1 - k0 + 1)
    if min(dims) < 1:
        raise _wrong(path, xml.image, "WholeExtent", "holds no voxels")
    di, dj, dk = _numbers(path, xml.image, "Spacing", "1 1 1")
    d = _numbers(path, xml.image, "Direction", "1 0 0 0 1 0 0 0 1")
    x, y, z = _numbers(path, xml.image, "Origin", "0 0 0")
    matrix: Matrix = (
        (d[0] * di, d[1] * dj, d[2] * dk),
        (d[3] * di, d[4] * dj, d[5] * dk),
        (d[6] * di, d[7] * dj, d[8] * dk),
    )
    return checked_geometry(path, dims, matrix, plus(applied(matrix, (float(i0), float(j0), float(k0))), (x, y, z)))


def _numbers(path: Path, attributes: Attributes, name: str, default: str) -> list[float]:
    """The attribute's numbers, as many as the default has; whole ones where it is an extent."""
    try:
        numbers = [float(word) for word in attributes.get(name, default).split()]
    except ValueError:
        numbers = []
    whole = name != "WholeExtent" or all(number.is_integer() for number in numbers)
    if len(numbers) != len(default.split()) or not whole:
        raise _wrong(path, attributes, name, f"is not {len(default.split())} numbers")
    return numbers


def _chosen(path: Path, part: str, xml: _Xml) -> _Element:
    """The array that the part names, else the active scalars, else the only array of single numbers."""
    names = ", ".join(f"{one.name} ({one.components} components)" for one in xml.arrays if one.components != "1")
    scalars = [one for one in xml.arrays if one.components == "1"]
    wanted = part or xml.points.get("Scalars", "")
    named = [one for one in xml.arrays if one.name == wanted and (part or one in scalars)]
    if named and named[0].components != "1":
        raise BadInput(
            f"{path}: “{part}” has {named[0].components} components, volsplat needs one number a voxel; "
            "save one component or the magnitude"
        )
    if named or (not part and len(scalars) == 1):
        return (named or scalars)[0]
    listed = ", ".join(one.name for one in scalars)
    if part:
        raise BadInput(f"{path}: has no point array “{part}”; it has {listed or names or 'none'}")
    if scalars:
        raise BadInput(f"{path}: holds {listed}; choose one, as in {path}#{scalars[0].name}")
    if xml.arrays:
        raise BadInput(
            f"{path}: has only {names}, volsplat needs one number a voxel; save a component or the magnitude"
        )
    cells = "has data of cells only; make point data of it (ParaView's filter Cell Data to Point Data)"
    raise BadInput(f"{path}: {cells if xml.cell_arrays else 'has no data of its points; save the image again'}")


def _voxels(
    path: Path, xml: _Xml, element: _Element, geometry: Geometry, scalar_type: str
) -> tuple[BoxesOfVoxels, str]:
    """The array's voxels, and why they are read whole, "" where they are not. Raises BadInput where they cannot be."""
    stored = element.attributes.get("format", "")
    order = BYTE_ORDERS.get(xml.file.get("byte_order", ""))
    length_type = LENGTH_TYPES.get(xml.file.get("header_type", "UInt32"))
    compressor = xml.file.get("compressor", "")
    if order is None:
        raise _wrong(path, xml.file, "byte_order", "is neither LittleEndian nor BigEndian")
    if length_type is None:
        raise _wrong(path, xml.file, "header_type", "is neither UInt32 nor UInt64")
    if compressor not in ("", *COMPRESSORS) and stored != "ascii":
        raise BadInput(f"{path}: is compressed by {compressor}, which is not read; save it with ZLib or uncompressed")
    if stored not in ("ascii", "binary", "appended"):
        raise _wrong(path, element.attributes, "format", "is none of ascii, binary, appended")
    base64 = stored == "binary" or stored == "appended" and (xml.appended or {}).get("encoding") != "raw"
    array = VtkArray(
        path=path,
        dims=geometry.dims,
        dtype=np.dtype(scalar_type).newbyteorder(order),
        length_type=np.dtype(order + length_type),
        start=_appended_at(path, xml, element) if stored == "appended" else element.start,
    )
    if array.start < 0:
        raise array.damaged("the array is empty")
    if stored == "ascii":
        return TextVoxels(array, element.end), "the voxels are written as text"
    why_whole = "the voxels are in base64" if base64 else ""
    if compressor:
        return BlockVoxels(array, COMPRESSORS[compressor], base64), why_whole
    return (Base64Voxels(array), why_whole) if base64 else (stored_voxels(array), "")


def _appended_at(path: Path, xml: _Xml, element: _Element) -> int:
    if xml.appended is None:
        raise BadInput(f"{path}: its appended data is missing; the file is truncated, save or fetch it again")
    offset = element.attributes.get("offset", "")
    if not offset.isdecimal():
        raise _wrong(path, element.attributes, "offset", "is no place in the appended data")
    return xml.appended_start + int(offset)
