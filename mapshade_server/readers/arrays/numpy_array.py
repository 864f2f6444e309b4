"""NumPy's .npy and .npz, the latter by the array's name. Indexed [z, y, x], unless `axes=xyz` says other.

Only the wanted box is read, unless an .npz compresses its arrays.
Pickled objects are never loaded: they are programs.
"""

import warnings
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.array_file import ArrayFile, cause
from volsplat.mapshade_server.readers.arrays.array_grid import ArrayAxis, ArrayGrid, array_grid
from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart, array_part
from volsplat.mapshade_server.readers.arrays.array_values import ArrayValues, plain_values
from volsplat.mapshade_server.readers.reading.stored_voxels import READ_THROUGH_BYTES
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

MAGIC = b"\x93NUMPY"
MEMBER_MAGIC = b"PK\3\4"
MEMBER_HEADER_BYTES = 30  # before the name of a zip's member
MOST_GROWTH = 1032  # of deflated bytes
NPY, NPZ = ".npy", ".npz"


def recognises(head: bytes) -> bool:
    return head.startswith(MAGIC)


def recognises_npz(head: bytes) -> bool:
    name_end = MEMBER_HEADER_BYTES + int.from_bytes(head[26:28], "little")
    return head.startswith(MEMBER_MAGIC) and head[MEMBER_HEADER_BYTES:name_end].endswith(NPY.encode())


Pick = Callable[[tuple[int | slice, ...]], NDArray[Any]]  # gives what indexing an array would give


class NumpyArrayReader:
    """One array; `pick` reads what is wanted of it."""

    def __init__(self, description: VolumeDescription, grid: ArrayGrid, values: ArrayValues, pick: Pick) -> None:
        self._description = description
        self._grid = grid
        self._values = values
        self._pick = pick

    def describe(self) -> VolumeDescription:
        return self._description

    def read(self, box: Box) -> Voxels:
        return self._values.of(self._pick(self._grid.selection(box)))


def open_npy(path: Path, part: str) -> NumpyArrayReader:
    """The reader for a .npy file. Raises BadInput where it holds no volume or is truncated."""
    chosen = array_part(path, part)
    if chosen.path:
        raise BadInput(f"{path}: holds one array, it has no part “{chosen.path}”; leave out #{chosen.path}")
    with path.open("rb") as file:
        header = _header(chosen, file)
        start = file.tell()
    return _reader(path, chosen, header, _stored(path, chosen, header, start), "")


def open_npz(path: Path, part: str) -> NumpyArrayReader:
    """The reader for an array in an .npz. Raises BadInput where none or another must be chosen."""
    chosen = array_part(path, part)
    try:
        with zipfile.ZipFile(path) as archive:
            member = _member(chosen, archive)
            chosen = chosen._replace(path=member.filename.removesuffix(NPY))
            with archive.open(member) as file:
                header = _header(chosen, file)
                start = file.tell()
            if member.compress_type == zipfile.ZIP_STORED:
                offset = _offset(path, member) + start
                return _reader(path, chosen, header, _stored(path, chosen, header, offset), "")
            _check_size(chosen, header, member.file_size - start)
            if member.compress_size * MOST_GROWTH < header.bytes:
                raise _truncated(chosen, header, f"{member.compress_size} compressed")
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise _damaged(chosen, error) from None
    return _reader(path, chosen, header, _unpacked(path, chosen, member), "the array is compressed in its .npz")


class _Header(NamedTuple):
    """Of one array, before its numbers."""

    shape: tuple[int, ...]
    order: Literal["C", "F"]
    dtype: "np.dtype[Any]"

    @property
    def bytes(self) -> int:
        count = self.dtype.itemsize
        for length in self.shape:
            count *= length
        return count


def _header(part: ArrayPart, file: IO[bytes]) -> _Header:
    """The header at the file's position, which is then behind it."""
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    try:
        with warnings.catch_warnings(action="ignore"):  # headers written by Python 2
            version = npy.read_magic(file)
            shape, fortran, dtype = read[version](file)
    except Exception:  # whatever the evaluation of a damaged header ends in
        raise BadInput(f"{part.whole}: its NumPy header cannot be read; save the array again") from None
    if dtype.hasobject:
        raise BadInput(f"{part.whole}: holds pickled Python objects, which are never loaded; save an array of numbers")
    if min(shape, default=0) < 0:
        raise BadInput(f"{part.whole}: its NumPy header has the shape {shape}; save the array again")
    return _Header(shape, "F" if fortran else "C", dtype)


def _check_size(part: ArrayPart, header: _Header, there: int) -> None:
    if there < header.bytes:
        raise _truncated(part, header, str(there))


def _truncated(part: ArrayPart, header: _Header, there: str) -> BadInput:
    return BadInput(
        f"{part.whole}: the header promises {header.bytes} bytes of numbers, but the file holds only {there}; "
        "it is truncated or the header's shape is wrong"
    )


def _damaged(part: ArrayPart, error: Exception) -> BadInput:
    return BadInput(f"{part.whole}: the .npz is damaged or truncated ({error}); save or fetch it again")


def _member(part: ArrayPart, archive: zipfile.ZipFile) -> zipfile.ZipInfo:
    """The array that the part names, or the only one with enough axes."""
    arrays = {member.filename.removesuffix(NPY): member for member in archive.infolist()}
    if part.path:
        if part.path in arrays:
            return arrays[part.path]
        raise BadInput(f"{part.place}: has no array “{part.path}”; it holds {', '.join(arrays)}")
    volumes = []
    for name, member in arrays.items():
        with archive.open(member) as file:
            shape = _header(part._replace(path=name), file).shape
        if len(shape) >= 3:
            volumes.append((name, f"{name} {' x '.join(str(length) for length in shape)}"))
    if len(volumes) == 1:
        return arrays[volumes[0][0]]
    if not volumes:
        raise BadInput(f"{part.place}: none of its arrays has three axes; it holds {', '.join(arrays) or 'none'}")
    listed = ", ".join(shown for _, shown in volumes)
    raise BadInput(f"{part.place}: holds {listed}; choose one, as in {part.place}#{volumes[0][0]}")


def _offset(path: Path, member: zipfile.ZipInfo) -> int:
    """Where in the file the stored bytes of the member start."""
    with path.open("rb") as file:
        file.seek(member.header_offset)
        head = file.read(MEMBER_HEADER_BYTES)
    name, extra = int.from_bytes(head[26:28], "little"), int.from_bytes(head[28:30], "little")
    return member.header_offset + MEMBER_HEADER_BYTES + name + extra


def _stored(path: Path, part: ArrayPart, header: _Header, offset: int) -> Pick:
    _check_size(part, header, path.stat().st_size - offset)
    file = ArrayFile(path, offset, header.dtype, header.shape, header.order)

    def pick(selection: tuple[int | slice, ...]) -> NDArray[Any]:
        try:
            return file.pick(selection)
        except (EOFError, OSError) as error:
            raise BadInput(f"{part.whole}: {cause(error)}; fetch or save the array again") from None

    return pick


def _unpacked(path: Path, part: ArrayPart, member: zipfile.ZipInfo) -> Pick:
    @cache
    def load() -> NDArray[Any]:
        try:
            with zipfile.ZipFile(path) as archive, archive.open(member) as file:
                numbers: NDArray[Any] = npy.read_array(file)
                return numbers
        except (zipfile.BadZipFile, zlib.error, EOFError, ValueError) as error:
            raise _damaged(part, error) from None

    return lambda selection: load()[selection].copy()


def _chunk(grid: ArrayGrid, header: _Header) -> Index:
    """Voxels along i, j, k that come together, since gaps between what is wanted are read through."""
    read_through = READ_THROUGH_BYTES // header.dtype.itemsize
    if header.order == "C":
        return grid.chunk(None, read_through)
    _, nj, nk = grid.geometry.dims
    return (1, min(-(-read_through // nk), nj), nk)


def _reader(path: Path, part: ArrayPart, header: _Header, pick: Pick, why_whole: str) -> NumpyArrayReader:
    values = plain_values(part.whole, header.dtype)
    grid = array_grid(part, [ArrayAxis(length) for length in header.shape])
    description = VolumeDescription(
        name=path.name,
        format="NumPy array",
        geometry=grid.geometry,
        scalar_type=values.scalar_type,
        unit=grid.unit,
        axes=grid.axes,
        warnings=grid.warnings,
        density_name=part.path or "density",
        reads_sub_cubes=not why_whole,
        chunk=_chunk(grid, header),
        why_whole=why_whole,
    )
    return NumpyArrayReader(description, grid, values, pick)
