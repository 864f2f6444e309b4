"""VTK's files of before XML (.vtk): STRUCTURED_POINTS and RECTILINEAR_GRID, as text or binary.

https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html. Numbers of binary files are big endian;
only the rows of a box are read from them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.grids import checked_geometry, refuse_vectors
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, ReadBox, VolumeFormat
from volsplat.mapshade_server.readers.vtk_files.legacy_vtk_header import (
    COLOUR_TEXT,
    LegacyArray,
    LegacyHeader,
    legacy_header,
)
from volsplat.mapshade_server.readers.vtk_files.vtk_arrays import VtkArray, text_voxels
from volsplat.mapshade_server.readers.vtk_files.vtk_choice import chosen_array, ghosts_of, parts_of_arrays
from volsplat.mapshade_server.readers.vtk_files.vtk_grid import GridArray, opened_grid
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.text.errors import BadInput

MAGIC = b"# vtk datafile version"


def open_legacy_vtk(path: Path, part: str) -> OpenedVolume:
    """The reader for a .vtk. Raises BadInput if it is no grid, or an array of scalars must be named."""
    header = legacy_header(path)
    array, component = chosen_array(path, part, header.arrays, header.active)
    if not array.scalar_type:
        refuse_vectors(path, f"voxels of type {array.stated_type} in {array.name}")
    why_whole = "" if header.binary else "the voxels are written as text"
    read = _counted(path, header, array)
    parts = parts_of_arrays(part, header.arrays)
    ghosts = ghosts_of(header.arrays, lambda one: _counted(path, header, one), bool(why_whole))
    drawn = GridArray(array.name, array.scalar_type, array.of_cells, read, why_whole, parts, component, ghosts)
    if header.kind == "RECTILINEAR_GRID":
        return opened_grid(path, drawn, [_places(path, header, one) for one in header.coordinates])
    return opened_grid(path, drawn, checked_geometry(path, header.planes, header.spacing, header.origin))


def _counted(path: Path, header: LegacyHeader, array: LegacyArray) -> Callable[[Index], ReadBox]:
    """The array's reader. Raises BadInput unless it has as many values as its grid has points or cells."""
    ni, nj, nk = (max(planes - array.of_cells, 1) for planes in header.planes)
    if ni * nj * nk != array.count:
        raise BadInput(f"{path}: {array.name} has {array.count} values for {ni} x {nj} x {nk}; save the grid again")
    return _reader(path, header, array)


def _reader(path: Path, header: LegacyHeader, array: LegacyArray) -> Callable[[Index], ReadBox]:
    shares = array.stated_type == COLOUR_TEXT
    dtype = np.dtype("f4" if shares else array.scalar_type).newbyteorder(">")

    def reader(dims: Index) -> ReadBox:
        if not header.binary:
            read = text_voxels(VtkArray(path, dims, dtype, np.dtype("u4"), array.start), array.end)
            return (lambda box: np.rint(255 * read(box)).clip(0, 255).astype(np.uint8)) if shares else read
        voxels = StoredVoxels(path, dims, dtype, (Piece(path, dims[2], array.start),))
        voxels.check_files()
        return voxels.read

    return reader


def _places(path: Path, header: LegacyHeader, array: LegacyArray) -> NDArray[Any]:
    """The coordinates of the planes along one axis."""
    if not array.scalar_type:
        refuse_vectors(path, f"coordinates of type {array.stated_type}")
    dims = (array.count, 1, 1)
    return _reader(path, header, array)(dims)(Box((0, 0, 0), dims)).ravel()


FORMATS = (VolumeFormat("VTK image or grid (.vtk)", open_legacy_vtk, lambda head: head[: len(MAGIC)].lower() == MAGIC),)
