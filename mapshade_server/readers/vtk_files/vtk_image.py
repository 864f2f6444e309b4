"""VTK's ImageData and RectilinearGrid as XML (.vti, .vtr): the array of points or cells that is meant."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.cell_grid import grid_of_cells
from volsplat.mapshade_server.readers.arrays.uneven_axes import EvenGrid, even_axis, geometry_of, middles
from volsplat.mapshade_server.readers.reading.simple_itk import checked_geometry
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume
from volsplat.mapshade_server.readers.vtk_files.vtk_arrays import (
    COMPRESSORS,
    Base64Voxels,
    BlockVoxels,
    BoxesOfVoxels,
    TextVoxels,
    VtkArray,
    stored_voxels,
)
from volsplat.mapshade_server.readers.vtk_files.vtk_choice import chosen_array
from volsplat.mapshade_server.readers.vtk_files.vtk_xml import Attributes, VtkElement, VtkXml, vtk_xml
from volsplat.protocol.description.volume import Box, Geometry, Index, VolumeDescription
from volsplat.protocol.geometry.matrices import Matrix, applied, plus
from volsplat.protocol.text.errors import BadInput

SCALAR_TYPES = {
    **{f"{sign}Int{bits}": f"{sign.lower()}int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "Float32": "float32",
    "Float64": "float64",
}
LENGTH_TYPES = {"UInt32": "u4", "UInt64": "u8"}
BYTE_ORDERS: dict[str, Literal["<", ">"]] = {"LittleEndian": "<", "BigEndian": ">"}


def recognises(head: bytes) -> bool:
    return b"<VTKFile" in head and head.lstrip(b"\xef\xbb\xbf \r\n\t").startswith((b"<?xml", b"<VTKFile", b"<!"))


def open_vtk_image(path: Path, part: str) -> OpenedVolume:
    """The reader for a .vti or .vtr. Raises BadInput where it has no array of scalars or one must be named."""
    xml = vtk_xml(path)
    element = chosen_array(path, part, xml.arrays, xml.active)
    rectilinear = xml.file.get("type") == "RectilinearGrid"
    geometry, grid, why_whole = (_rectilinear if rectilinear else _image)(path, xml, element)
    description = VolumeDescription(
        name=path.name,
        format=f"VTK {'rectilinear grid' if rectilinear else 'image'}{', values of cells' if element.of_cells else ''}",
        geometry=geometry,
        scalar_type=_scalar_type(path, element),
        density_name=element.name or "density",
        warnings=tuple(axis.warning for axis in grid.axes if axis.warning) if isinstance(grid, EvenGrid) else (),
        reads_sub_cubes=not why_whole,
        chunk=(geometry.dims[0], 1, 1),
        why_whole=why_whole,
    )
    return OpenedVolume(description, grid.read)


def _image(path: Path, xml: VtkXml, element: VtkElement) -> tuple[Geometry, BoxesOfVoxels, str]:
    geometry = _geometry(path, xml)
    if element.of_cells:
        geometry = grid_of_cells(path, geometry)
    return (geometry, *_voxels(path, xml, element, geometry.dims))


def _rectilinear(path: Path, xml: VtkXml, element: VtkElement) -> tuple[Geometry, BoxesOfVoxels, str]:
    """The grid that the coordinates of the planes make."""
    planes = _dims(path, xml)
    if len(xml.coordinates) != 3:
        raise BadInput(f"{path}: has {len(xml.coordinates)} arrays of coordinates instead of 3; save the grid again")
    places = [_places(path, xml, one, count) for one, count in zip(xml.coordinates, planes, strict=True)]
    if element.of_cells:
        places = [middles(one) for one in places]
    i, j, k = (even_axis(path, name, one) for name, one in zip("xyz", places, strict=True))
    voxels, why_whole = _voxels(path, xml, element, (len(places[0]), len(places[1]), len(places[2])))
    return geometry_of(path, (i, j, k)), EvenGrid((i, j, k), voxels), why_whole


def _places(path: Path, xml: VtkXml, element: VtkElement, count: int) -> NDArray[Any]:
    """The coordinates of the planes along one axis."""
    voxels, _ = _voxels(path, xml, element, (count, 1, 1))
    return voxels.read(Box((0, 0, 0), (count, 1, 1))).ravel()


def _scalar_type(path: Path, element: VtkElement) -> str:
    scalar_type = SCALAR_TYPES.get(element.attributes.get("type", ""))
    if scalar_type is None:
        raise _wrong(path, element.attributes, "type", "is no type of number that volsplat reads")
    return scalar_type


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
    """The attribute's numbers, as many as the default has; whole ones where it is an extent."""
    try:
        numbers = [float(word) for word in attributes.get(name, default).split()]
    except ValueError:
        numbers = []
    whole = name != "WholeExtent" or all(number.is_integer() for number in numbers)
    if len(numbers) != len(default.split()) or not whole:
        raise _wrong(path, attributes, name, f"is not {len(default.split())} numbers")
    return numbers


def _voxels(path: Path, xml: VtkXml, element: VtkElement, dims: Index) -> tuple[BoxesOfVoxels, str]:
    """The array's voxels, and why they are read whole, "" where they are not. Raises BadInput where they cannot be."""
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
    base64 = stored == "binary" or stored == "appended" and (xml.appended or {}).get("encoding") != "raw"
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
        return TextVoxels(array, element.end), "the voxels are written as text"
    why_whole = "the voxels are in base64" if base64 else ""
    if compressor:
        return BlockVoxels(array, COMPRESSORS[compressor], base64), why_whole
    return (Base64Voxels(array), why_whole) if base64 else (stored_voxels(array), "")


def _appended_at(path: Path, xml: VtkXml, element: VtkElement) -> int:
    if xml.appended is None:
        raise BadInput(f"{path}: its appended data is missing; the file is truncated, save or fetch it again")
    offset = element.attributes.get("offset", "")
    if not offset.isdecimal():
        raise _wrong(path, element.attributes, "offset", "is no place in the appended data")
    return xml.appended_start + int(offset)
