"""Raw voxels without a header, i fastest. What they are is stated, never guessed:

by the part of the volume's name, head.raw#dims=256x256x113,type=uint16,endian=big,skip=512,spacing=1x1x2,unit=mm;
by the same keys in head.raw.toml beside the file; or by the file's name, as the collections of volvis.org and
open-scivis have it, tooth_103x94x161_uint8.raw. The first of these counts for each key.
"""

import re
import tomllib
from pathlib import Path

import numpy as np

from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart, array_part
from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.mapshade_server.readers.reading.gzip_files import is_gzip
from volsplat.mapshade_server.readers.reading.headers_beside import header_naming
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.stored_voxels import BYTE_ORDERS, Piece, StoredVoxels, unpacked_size
from volsplat.mapshade_server.readers.reading.unpacked_stream import Packing
from volsplat.mapshade_server.readers.reading.volume_files import disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import (
    SCALAR_TYPES,
    OpenedVolume,
    VolumeFormat,
    packed_or_not,
)
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

KEYS = ("dims", "type", "endian", "skip", "spacing", "unit")
EXAMPLE = "dims=256x256x113,type=uint16,endian=big,skip=512,spacing=1x1x2"
NAME = re.compile(r"_(?P<dims>\d+x\d+x\d+)_(?P<type>\w+)\.raw(\.gz)?$", re.IGNORECASE)
LONGEST_SIDECAR = 1 << 16
HEADERS = (".nhdr", ".mhd", ".hdr")  # that people keep beside raw files


def describes(path: Path, part: str) -> bool:
    """Whether anybody says what is in the file, so that it may be read as raw voxels whatever its extension."""
    return "dims" in array_part(path, part).options or _sidecar(path).is_file() or NAME.search(path.name) is not None


def open_raw_voxels(path: Path, part: str) -> OpenedVolume:
    """The reader for raw voxels. Raises BadInput if they are not described or do not fill the file exactly."""
    said = _said(path, part)
    dims, scalar_type = said.whole_numbers("dims", 3), said.text("type", SCALAR_TYPES)
    if dims is None or scalar_type is None:
        raise _undescribed(path, said)
    if min(dims) < 1:
        raise said.wrong("dims", "needs at least one voxel on each axis")
    endian = said.text("endian", BYTE_ORDERS)
    dtype = np.dtype(scalar_type).newbyteorder(BYTE_ORDERS[endian or "little"])
    (skip,) = said.whole_numbers("skip", 1) or (0,)
    zipped = is_gzip(path) and path.name.lower().endswith(".gz")
    piece = Piece(path, dims[2], 0, Packing.DEFLATE, skip) if zipped else Piece(path, dims[2], skip)
    voxels = StoredVoxels(path, (dims[0], dims[1], dims[2]), dtype, (piece,))
    promised = skip + dims[2] * voxels.sheet_bytes
    _check_size(voxels, unpacked_size(path, 0, Packing.DEFLATE, promised) if zipped else path.stat().st_size, skip)
    warning = "nobody says in which byte order it is: little endian is taken; endian=big would be the other"
    description = VolumeDescription(
        name=path.name,
        format="raw voxels",
        geometry=checked_geometry(path, dims, said.numbers("spacing", 3) or (1.0, 1.0, 1.0)),
        scalar_type=scalar_type,
        unit=said.options.get("unit", ""),
        warnings=(warning,) if dtype.itemsize > 1 and endian is None else (),
        **voxels.access,
    )
    files = [file for file in (_sidecar(path), path) if file.is_file()]
    return OpenedVolume(description, voxels.read, lambda: disk_files(files), parts=())


def _said(path: Path, part: str) -> ArrayPart:
    """All that is said of the file: by the part, the sidecar and its name."""
    given = array_part(path, part)
    if given.path:
        raise BadInput(f"{path}: “{given.path}” does not describe raw voxels; write it as in {path}#{EXAMPLE}")
    match = NAME.search(path.name)
    by_name = {"dims": match["dims"].lower(), "type": match["type"].lower()} if match else {}
    said = ArrayPart(str(path), "", {**by_name, **_in_sidecar(path), **given.options})
    said.check_known(KEYS)
    return said


def _sidecar(path: Path) -> Path:
    return path.with_name(f"{path.name}.toml")


def _in_sidecar(path: Path) -> dict[str, str]:
    sidecar = _sidecar(path)
    if not sidecar.is_file():
        return {}
    try:
        with opened(sidecar) as file:
            entries = tomllib.loads(file.read(LONGEST_SIDECAR).decode())
        return {
            key: "x".join(str(entry) for entry in value) if isinstance(value, list) else str(value)
            for key, value in entries.items()
        }
    except (ValueError, RecursionError) as error:  # TOML's own, UTF-8's, and those of numbers of thousands of digits
        raise BadInput(f"{sidecar}: is not TOML ({' '.join(str(error).split())}); correct the file") from None


def _undescribed(path: Path, said: ArrayPart) -> BadInput:
    own = (path.with_suffix(extension) for extension in HEADERS)
    header = header_naming(path) or next((one for one in own if one.is_file()), None)
    if header is not None and not said.options:
        return BadInput(f"{path}: raw voxels without a header; open {header.name} beside it instead")
    missing = " and ".join(key for key in ("dims", "type") if key not in said.options)
    return BadInput(
        f"{path}: raw voxels without a header, of unknown {missing}; say what they are, as in {path}#{EXAMPLE} "
        f"or with these keys in {_sidecar(path).name}"
    )


def _check_size(voxels: StoredVoxels, size: int, skip: int) -> None:
    """Raises BadInput unless the voxels are all that the file holds."""
    promised = voxels.dims[2] * voxels.sheet_bytes
    if size == skip + promised:
        return
    shown = "x".join(str(n) for n in voxels.dims)
    more = size > promised
    hint = f"; skip={size - promised} would fit, if its first bytes are a header" if more and not voxels.packed else ""
    has = size if not voxels.packed else f"{'more' if more else size} unpacked"
    raise BadInput(
        f"{voxels.source}: {shown} voxels of {voxels.dtype.name} are {promised} bytes"
        f"{f' after {skip} skipped' if skip else ''}, but the file has {has}; correct dims, type or skip{hint}"
    )


FORMATS = (
    VolumeFormat("raw voxels (.raw)", open_raw_voxels, extensions=packed_or_not(".raw"), gzip=True, parts=False),
)
