"""NumPy's .npy and .npz, the latter by the array's name. Indexed [z, y, x], unless `axes=xyz` says other.

Only the wanted box is read, unless an .npz compresses its arrays.
Pickled objects are never loaded: they are programs.
"""

import warnings
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from numpy.lib import format as npy
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.array_file import ArrayFile, cause
from volsplat.mapshade_server.readers.arrays.array_grid import ArrayAxis, ArrayGrid, array_grid
from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart, array_part
from volsplat.mapshade_server.readers.arrays.array_values import plain_values
from volsplat.mapshade_server.readers.arrays.array_volume import Pick, array_told, array_volume, choose_one
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.stored_voxels import READ_THROUGH_BYTES
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat
from volsplat.protocol.description.volume import Index
from volsplat.protocol.text.errors import BadInput

MAGIC = b"\x93NUMPY"
MEMBER_MAGIC = b"PK\3\4"
MEMBER_HEADER_BYTES = 30  # before the name of a zip's member
MOST_GROWTH = 1032  # of deflated bytes
NPY = ".npy"
LENGTH_BYTES = {(1, 0): 2, (2, 0): 4}  # of a header, by its version
LONGEST_HEADER = 1 << 16


def recognises_npz(head: bytes) -> bool:
    name_end = MEMBER_HEADER_BYTES + int.from_bytes(head[26:28], "little")
    return head.startswith(MEMBER_MAGIC) and head[MEMBER_HEADER_BYTES:name_end].endswith(NPY.encode())


def open_npy(path: Path, part: str) -> OpenedVolume:
    """The reader for a .npy file. Raises BadInput if it holds no volume or is truncated."""
    chosen = array_part(path, part)
    if chosen.path:
        raise BadInput(f"{path}: holds one array, it has no part “{chosen.path}”; leave out #{chosen.path}")
    with opened(path) as file:
        return _stored(chosen, _array(chosen, file))


def open_npz(path: Path, part: str) -> OpenedVolume:
    """The reader for an array in an .npz. Raises BadInput if there is none or one must be chosen."""
    chosen = ArrayPart(str(path), part, {})
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {member.filename.removesuffix(NPY): member for member in archive.infolist()}
            chosen = array_part(path, part, arrays.__contains__)
            member = _member(chosen, archive, arrays)
            chosen = chosen._replace(path=member.filename.removesuffix(NPY))
            with archive.open(member) as file:
                array = _array(chosen, file)
            if member.compress_type == zipfile.ZIP_STORED:
                return _stored(chosen, replace(array, offset=_offset(path, member) + array.offset))
            _check_size(chosen, array, member.file_size - array.offset)
            if member.compress_size * MOST_GROWTH < array.nbytes:
                raise _truncated(chosen, array, f"{member.compress_size} compressed")
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise _damaged(chosen, error) from None
    return _reader(chosen, array, _unpacked(path, chosen, member), "the array is compressed in its .npz")


def _array(part: ArrayPart, file: IO[bytes]) -> ArrayFile:
    """The array whose header is at the file's position."""
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    try:
        with warnings.catch_warnings(action="ignore"):  # headers written by Python 2
            version = npy.read_magic(file)
            shape, fortran, dtype = read[version](_header(file, LENGTH_BYTES[version]))
    except Exception:  # whatever the evaluation of a damaged header ends in
        raise BadInput(f"{part.whole}: its NumPy header cannot be read; save the array again") from None
    if dtype.hasobject:
        raise BadInput(f"{part.whole}: holds pickled Python objects, which are never loaded; save an array of numbers")
    if min(shape, default=0) < 0:
        raise BadInput(f"{part.whole}: its NumPy header has the shape {shape}; save the array again")
    return ArrayFile(Path(part.place), file.tell(), dtype, shape, "F" if fortran else "C")


def _header(file: IO[bytes], length_bytes: int) -> IO[bytes]:
    """A header alone, which may be compressed, and claim any length. Raises ValueError."""
    stated = file.read(length_bytes)
    length = int.from_bytes(stated, "little")
    if length > LONGEST_HEADER:
        raise ValueError(f"it has {length} bytes")
    return BytesIO(stated + file.read(length))


def _check_size(part: ArrayPart, array: ArrayFile, there: int) -> None:
    if there < array.nbytes:
        raise _truncated(part, array, str(there))


def _truncated(part: ArrayPart, array: ArrayFile, there: str) -> BadInput:
    return BadInput(
        f"{part.whole}: the header promises {array.nbytes} bytes of numbers, but the file holds only {there}; "
        "it is truncated or the header's shape is wrong"
    )


def _damaged(part: ArrayPart, error: Exception) -> BadInput:
    return BadInput(f"{part.whole}: the .npz is damaged or truncated ({error}); save or fetch it again")


def _member(part: ArrayPart, archive: zipfile.ZipFile, arrays: Mapping[str, zipfile.ZipInfo]) -> zipfile.ZipInfo:
    """The array that the part names, or the only one with enough axes."""
    if part.path:
        if part.path in arrays:
            return arrays[part.path]
        raise BadInput(f"{part.place}: has no array “{part.path}”; it holds {', '.join(arrays)}")
    volumes = {}
    for name, member in arrays.items():
        with archive.open(member) as file:
            shape = _array(part._replace(path=name), file).shape
        if len(shape) >= 3:
            volumes[name] = array_told(name, shape)
    if not volumes:
        raise BadInput(f"{part.place}: none of its arrays has three axes; it holds {', '.join(arrays) or 'none'}")
    if len(volumes) > 1:
        raise choose_one(part, part.place, list(volumes.values()))
    return arrays[next(iter(volumes))]


def _offset(path: Path, member: zipfile.ZipInfo) -> int:
    """Where in the file the stored bytes of the member start."""
    with opened(path) as file:
        file.seek(member.header_offset)
        head = file.read(MEMBER_HEADER_BYTES)
    name, extra = int.from_bytes(head[26:28], "little"), int.from_bytes(head[28:30], "little")
    return member.header_offset + MEMBER_HEADER_BYTES + name + extra


def _stored(part: ArrayPart, array: ArrayFile) -> OpenedVolume:
    _check_size(part, array, array.path.stat().st_size - array.offset)

    def pick(selection: tuple[int | slice, ...]) -> NDArray[Any]:
        try:
            return array.pick(selection)
        except (EOFError, OSError) as error:
            raise BadInput(f"{part.whole}: {cause(error)}; fetch or save the array again") from None

    return _reader(part, array, pick)


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


def _reader(part: ArrayPart, array: ArrayFile, pick: Pick, why_whole: str = "") -> OpenedVolume:
    values = plain_values(part.whole, array.dtype)
    grid = array_grid(part, [ArrayAxis(length) for length in array.shape])
    return array_volume(
        part,
        "NumPy array",
        grid,
        values,
        pick,
        density_name=part.path,
        chunk=_chunk(grid, array),
        why_whole=why_whole,
        parts=(),
    )


def _chunk(grid: ArrayGrid, array: ArrayFile) -> Index:
    """Voxels along i, j, k that come together, since gaps between what is wanted are read through."""
    read_through = READ_THROUGH_BYTES // array.dtype.itemsize
    if array.order == "C":
        return grid.chunk(None, read_through)
    _, nj, nk = grid.geometry.dims
    return (1, min(-(-read_through // nk), nj), nk)


FORMATS = (
    VolumeFormat("NumPy array (.npy)", open_npy, lambda head: head.startswith(MAGIC)),
    VolumeFormat("NumPy arrays (.npz)", open_npz, recognises_npz),
)
