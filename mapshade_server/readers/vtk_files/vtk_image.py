"""VTK's ImageData and RectilinearGrid as XML (.vti, .vtr): the array of points or cells that is meant."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, ReadBox, VolumeFormat
from volsplat.mapshade_server.readers.vtk_files.vtk_arrays import (
    COMPRESSORS,
    BlockVoxels,
    VtkArray,
    base64_voxels,
    stored_voxels,
    text_voxels,
)
from volsplat.mapshade_server.readers.vtk_files.vtk_choice import chosen_array, ghosts_of, parts_of_arrays
from volsplat.mapshade_server.readers.vtk_files.vtk_grid import GridArray, opened_grid
from volsplat.mapshade_server.readers.vtk_files.vtk_xml import Attributes, VtkElement, VtkXml, vtk_xml
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry.matrices import Matrix, applied, plus
from volsplat.protocol.text.errors import BadInput

LENGTH_TYPES = {"UInt32": "u4", "UInt64": "u8"}
BYTE_ORDERS: dict[str, Literal["<", ">"]] = {"LittleEndian": "<", "BigEndian": ">"}


def recognises(head: bytes) -> bool:
    return b"<VTKFile" in head and head.lstrip(b"\xef\xbb\xbf \r\n\t").startswith((b"<?xml", b"<VTKFile", b"<!"))


def open_vtk_image(path: Path, part: str) -> OpenedVolume:
    """The reader for a .vti or .vtr. Raises BadInput if it has no array of scalars or one must be named."""
    xml = vtk_xml(path)
    element, component = chosen_array(path, part, xml.arrays, xml.active)
    drawn = GridArray(
        name=element.name,
        scalar_type=_scalar_type(path, element),
        of_cells=element.of_cells,
        reader=_reader(path, xml, element),
        why_whole=_why_whole(xml, element),
        parts=parts_of_arrays(part, xml.arrays),
        component=component,
        ghosts=ghosts_of(xml.arrays, lambda one: _reader(path, xml, one), bool(_why_whole(xml, element))),
    )
    if xml.file.get("type") != "RectilinearGrid":
        return opened_grid(path, drawn, _geometry(path, xml))
    planes = _dims(path, xml)
    if len(xml.coordinates) != 3:
        raise BadInput(f"{path}: has {len(xml.coordinates)} arrays of coordinates instead of 3; save the grid again")
    places = [_places(path, xml, one, count) for one, count in zip(xml.coordinates, planes, strict=True)]
    return opened_grid(path, drawn, places)


def _reader(path: Path, xml: VtkXml, element: VtkElement) -> Callable[[Index], ReadBox]:
    return lambda dims: _voxels(path, xml, element, dims)


def _why_whole(xml: VtkXml, element: VtkElement) -> str:
    """Why the voxels are read whole, "" if they are not."""
    stored = element.attributes.get("format", "")
    if stored == "ascii":
        return "the voxels are written as text"
    return "the voxels are in base64" if _is_base64(xml, stored) else ""


def _is_base64(xml: VtkXml, stored: str) -> bool:
    return stored == "binary" or stored == "appended" and (xml.appended or {}).get("encoding") != "raw"


def _places(path: Path, xml: VtkXml, element: VtkElement, count: int) -> NDArray[Any]:
    """The coordinates of the planes along one axis."""
    return _voxels(path, xml, element, (count, 1, 1))(Box((0, 0, 0), (count, 1, 1))).ravel()


def _scalar_type(path: Path, element: VtkElement) -> str:
    if not element.scalar_type:
        raise _wrong(path, element.attributes, "type", "is no type of number that volsplat reads")
    return element.scalar_type


def _wrong(path: Path, attributes: Attributes, name: str, why: str) -> BadInput:
    return BadInput(f'{path}: {name}="{attributes.get(name, "")}" {why}; correct the file')


def _dims(path: Path, xml: VtkXml) -> Index:
    """How many points there are along each axis."""
    i0, i1, j0, j1, k0, k1 = _extent(path, xml)
    dims = (i1 - i0 + 1, j1 - j0 + 1, k1 - k0 + 1)
    if min(dims) < 1:
        raise _wrong(path, xml.grid, "WholeExtent", "holds no voxels")
    return dims


def _extent(path: Path, xml: VtkXml) -> list[int]:
    return [int(number) for number in _numbers(path, xml.grid, "WholeExtent", "0 -1 0 -1 0 -1")]


def _geometry(path: Path, xml: VtkXml) -> Geometry:
    """The image's points. Origin is the place of index 0, whether or not the extent holds that."""
    i0, _, j0, _, k0, _ = _extent(path, xml)
    di, dj, dk = _numbers(path, xml.grid, "Spacing", "1 1 1")
    d = _numbers(path, xml.grid, "Direction", "1 0 0 0 1 0 0 0 1")
    x, y, z = _numbers(path, xml.grid, "Origin", "0 0 0")
    matrix: Matrix = (
        (d[0] * di, d[1] * dj, d[2] * dk),
        (d[3] * di, d[4] * dj, d[5] * dk),
        (d[6] * di, d[7] * dj, d[8] * dk),
    )
    return checked_geometry(
        path, _dims(path, xml), matrix, plus(applied(matrix, (float(i0), float(j0), float(k0))), (x, y, z))
    )


def _numbers(path: Path, attributes: Attributes, name: str, default: str) -> list[float]:
    """The attribute's numbers, as many as the default has; whole ones if it is an extent."""
    try:
        numbers = [float(word) for word in attributes.get(name, default).split()]
    except ValueError:
        numbers = []
    whole = name != "WholeExtent" or all(number.is_integer() for number in numbers)
    if len(numbers) != len(default.split()) or not whole:
        raise _wrong(path, attributes, name, f"is not {len(default.split())} numbers")
    return numbers


def _voxels(path: Path, xml: VtkXml, element: VtkElement, dims: Index) -> ReadBox:
    """What reads the array's voxels. Raises BadInput if they cannot be read."""
    scalar_type = _scalar_type(path, element)
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
    array = VtkArray(
        path=path,
        dims=dims,
        dtype=np.dtype(scalar_type).newbyteorder(order),
        length_type=np.dtype(order + length_type),
        start=_appended_at(path, xml, element) if stored == "appended" else element.start,
    )
    if array.start < 0:
        raise array.damaged("the array is empty")
    if stored == "ascii":
        return text_voxels(array, element.end)
    base64 = _is_base64(xml, stored)
    if compressor:
        return BlockVoxels(array, COMPRESSORS[compressor], base64).read
    return base64_voxels(array) if base64 else stored_voxels(array).read


def _appended_at(path: Path, xml: VtkXml, element: VtkElement) -> int:
    if xml.appended is None:
        raise BadInput(f"{path}: its appended data is missing; the file is truncated, save or fetch it again")
    offset = element.attributes.get("offset", "")
    if not offset.isdecimal():
        raise _wrong(path, element.attributes, "offset", "is no place in the appended data")
    return xml.appended_start + int(offset)


FORMATS = (VolumeFormat("VTK image or grid (.vti, .vtr)", open_vtk_image, recognises),)
