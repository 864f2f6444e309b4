"""VTK's files of before XML (.vtk): STRUCTURED_POINTS and RECTILINEAR_GRID, as text or binary.

https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html. Numbers of binary files are big endian;
only the rows of a box are read from them.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.cell_grid import grid_of_cells
from volsplat.mapshade_server.readers.arrays.uneven_axes import EvenGrid, even_axis, geometry_of, middles
from volsplat.mapshade_server.readers.reading.simple_itk import checked_geometry, refuse_vectors
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume
from volsplat.mapshade_server.readers.vtk_files.legacy_vtk_header import LegacyArray, LegacyHeader, legacy_header
from volsplat.mapshade_server.readers.vtk_files.vtk_arrays import BoxesOfVoxels, TextVoxels, VtkArray
from volsplat.mapshade_server.readers.vtk_files.vtk_choice import chosen_array
from volsplat.protocol.description.volume import Box, Geometry, Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

MAGIC = b"# vtk datafile version"


def recognises(head: bytes) -> bool:
    return head[: len(MAGIC)].lower() == MAGIC


def open_legacy_vtk(path: Path, part: str) -> OpenedVolume:
    """The reader for a .vtk. Raises BadInput where it is no grid, or an array of scalars must be named."""
    header = legacy_header(path)
    array = chosen_array(path, part, header.arrays, header.active)
    if not array.scalar_type:
        refuse_vectors(path, f"voxels of type {array.stated_type} in {array.name}")
    rectilinear = header.kind == "RECTILINEAR_GRID"
    warnings: tuple[str, ...] = ()
    dims = _dims(path, header, array)
    voxels = _voxels(path, header, array, dims)
    if rectilinear:
        places = [_places(path, header, one) for one in header.coordinates]
        i, j, k = (
            even_axis(path, name, middles(one) if array.of_cells else one)
            for name, one in zip("xyz", places, strict=True)
        )
        voxels, geometry = EvenGrid((i, j, k), voxels), geometry_of(path, (i, j, k))
        warnings = tuple(axis.warning for axis in (i, j, k) if axis.warning)
    else:
        geometry = _geometry(path, header)
        geometry = grid_of_cells(path, geometry) if array.of_cells else geometry
    why_whole = "" if header.binary else "the voxels are written as text"
    description = VolumeDescription(
        name=path.name,
        format=f"VTK {'rectilinear grid' if rectilinear else 'image'}{', values of cells' if array.of_cells else ''}",
        geometry=geometry,
        scalar_type=array.scalar_type,
        density_name=array.name,
        warnings=warnings,
        reads_sub_cubes=not why_whole,
        chunk=(geometry.dims[0], 1, 1),
        why_whole=why_whole,
    )
    return OpenedVolume(description, voxels.read)


def _dims(path: Path, header: LegacyHeader, array: LegacyArray) -> Index:
    """How many values the array has along each axis. Raises BadInput where they are not as many as it holds."""
    less = 1 if array.of_cells else 0
    ni, nj, nk = (max(planes - less, 1) for planes in header.planes)
    if ni * nj * nk != array.count:
        raise BadInput(f"{path}: {array.name} has {array.count} values for {ni} x {nj} x {nk}; save the grid again")
    return ni, nj, nk


def _geometry(path: Path, header: LegacyHeader) -> Geometry:
    di, dj, dk = header.spacing
    return checked_geometry(path, header.planes, ((di, 0.0, 0.0), (0.0, dj, 0.0), (0.0, 0.0, dk)), header.origin)


def _voxels(path: Path, header: LegacyHeader, array: LegacyArray, dims: Index) -> BoxesOfVoxels:
    dtype = np.dtype(array.scalar_type).newbyteorder(">")
    if not header.binary:
        return TextVoxels(VtkArray(path, dims, dtype, np.dtype("u4"), array.start), array.end)
    voxels = StoredVoxels(path, dims, dtype, (Piece(path, dims[2], array.start),))
    voxels.check_files()
    return voxels


def _places(path: Path, header: LegacyHeader, array: LegacyArray) -> NDArray[Any]:
    """The coordinates of the planes along one axis."""
    if not array.scalar_type:
        refuse_vectors(path, f"coordinates of type {array.stated_type}")
    dims = (array.count, 1, 1)
    return _voxels(path, header, array, dims).read(Box((0, 0, 0), dims)).ravel()
