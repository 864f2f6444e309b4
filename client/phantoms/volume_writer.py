"""Writes volumes, whole or not at all: NRRD some sheets at a time, other formats through SimpleITK."""

import importlib
import os
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import torch

from volsplat.client.files.whole_file import is_stream
from volsplat.client.phantoms.centred_grid import Phantom
from volsplat.program.temporary_name import behind_links, take_mode, temporary_name
from volsplat.protocol.description.kind import stated
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

# By extension: whether SimpleITK compresses. NRRD and MetaImage stay raw, so that servers can read sub-cubes.
COMPRESSED = {
    ".nrrd": False,
    ".nhdr": False,
    ".mha": False,
    ".mhd": False,
    ".nii": False,
    ".nii.gz": True,
    ".tif": True,
    ".tiff": True,
}
NRRD = (".nrrd", ".nhdr")
HEADERS = (".nhdr", ".mhd")  # whose voxels lie beside them
PATIENT = ("space: left-posterior-superior",)
TRIED_BYTES = 1 << 16  # more than a disk has left that has just filled up, but for what compression holds back
NIFTI_GZ, NIFTI_HEADER = ".nii.gz", 352  # bytes; SimpleITK says nothing if the disk is full
NRRD_TYPES = {
    torch.uint8: "uchar",
    torch.int8: "signed char",
    torch.uint16: "ushort",
    torch.int16: "short",
    torch.uint32: "uint",
    torch.int32: "int",
    torch.uint64: "unsigned long long int",
    torch.int64: "long long int",
    torch.float32: "float",
    torch.float64: "double",
}
SHEARLESS = (".nii", ".nii.gz", ".tif", ".tiff")
PAGED = (".tif", ".tiff")  # a slice a page, and nothing that tells one slice from an image
SHEAR_TOLERANCE = 1e-5  # of the cosine between two grid axes


def written_at(path: Path) -> Path:
    """Where the volume goes: to `path`, or where that leads as a link.

    A header with voxels beside it takes the link's place: by the link's name its voxels would be looked for there.
    Raises BadInput if it has no extension of a volume or cannot be written. Leaves nothing behind.
    """
    extension, asked = extension_of(path), path
    if extension not in HEADERS:
        path = behind_links(asked)
    if _extension_if_any(path) != extension:
        raise BadInput(f"{asked}: leads to {path}, which is not named {extension}; give both the same extension")
    folder = path.parent
    if not folder.is_dir():
        raise BadInput(f"{path}: there is no folder {folder}; make it first")
    if path.is_dir():
        raise BadInput(f"{path}: is a folder; name a file")
    if is_stream(path):
        raise BadInput(f"{path}: no volume is written into a pipe or a device; name a file")
    if not os.access(folder, os.W_OK) or path.exists() and not os.access(path, os.W_OK):
        raise BadInput(f"{path}: cannot be written; choose another place or change its permissions")
    return path


def check_voxels_apart(path: Path) -> None:
    """Raises BadInput where voxels beside a new header would take the place of a file that is there already."""
    voxels = path.with_suffix(".raw")
    if extension_of(path) in HEADERS and voxels.exists() and not path.exists():
        raise BadInput(f"{path}: its voxels would go into {voxels}, which is there already; choose another name")


def extension_of(path: Path) -> str:
    """The extension that decides the format. Raises BadInput for one that is not written."""
    if extension := _extension_if_any(path):
        return extension
    raise BadInput(f"{path}: volumes are not written in this format; name it one of {', '.join(COMPRESSED)}")


def _extension_if_any(path: Path) -> str:
    for extension in sorted(COMPRESSED, key=len, reverse=True):
        if path.name.lower().endswith(extension) and len(path.name) > len(extension):
            return extension
    return ""


def write_volume(path: Path, values: torch.Tensor, geometry: Geometry) -> None:
    """Writes `values`, shaped (k, j, i), with their place in space, taken as LPS, to `path`.

    The files appear under their names only when they are complete; a link stays one, but for a header's. TIFF keeps no
    place in space but the spacing along i and j. Raises BadInput for unknown extensions, for shear or a single slice
    that the format cannot hold, and if the disk refuses.
    """
    _write_volume(written_at(path), values, geometry)


def _write_volume(path: Path, values: torch.Tensor, geometry: Geometry) -> None:
    """At a place as `written_at` tells it."""
    extension = extension_of(path)
    if extension in SHEARLESS and _shear(geometry) > SHEAR_TOLERANCE:
        raise BadInput(f"{path}: {extension} would lose the volume's shear; write .nrrd or .mha")
    if extension in PAGED and geometry.dims[2] == 1:
        raise BadInput(f"{path}: {extension} of one slice would be read as an image; write .nrrd or .mha")
    if extension in NRRD:
        _write_nrrd(path, [values], values.dtype, geometry)
        return
    # Here, since whoever writes no volume should not wait for this import.
    simple_itk: Any = importlib.import_module("SimpleITK")
    simple_itk.ProcessObject_SetGlobalWarningDisplay(False)
    image = _placed(simple_itk.GetImageFromArray(values.contiguous().numpy()), geometry)
    with _appearing_whole(path) as folder:
        try:
            simple_itk.WriteImage(image, str(folder / path.name), COMPRESSED[extension])
        except RuntimeError as error:
            reason = _system_reason(folder) or str(error).strip().splitlines()[-1].strip()
            raise BadInput(f"{path}: cannot be written: {reason}; choose another place or format") from None
        written_bytes = sum(file.stat().st_size for file in folder.iterdir())
        missing = not COMPRESSED[extension] and written_bytes < values.nbytes
        if missing or extension == NIFTI_GZ and not _ends_as_gzip_of(folder / path.name, NIFTI_HEADER + values.nbytes):
            raise BadInput(f"{path}: could not be written whole: {_system_reason(folder) or 'the disk may be full'}")


def write_phantom(path: Path, phantom: Phantom) -> None:
    """As `write_volume`; NRRD some sheets at a time, with what values and axes are.

    All others get neither: their readers take lengths for mm, and axes for a patient's.
    """
    path = written_at(path)
    if extension_of(path) in NRRD:
        pairs = stated(phantom.kind, phantom.bands)
        _write_nrrd(path, phantom.sheets, phantom.dtype, phantom.geometry, _space_of(phantom), pairs)
    else:
        _write_volume(path, *phantom.whole())


def _space_of(phantom: Phantom) -> tuple[str, ...]:
    unit = f'"{phantom.unit}"'
    units = (f"space units: {unit} {unit} {unit}",) if phantom.unit else ()
    return (*(PATIENT if phantom.anatomical else ("space dimension: 3",)), *units)


def _write_nrrd(
    path: Path,
    sheets: Iterable[torch.Tensor],
    dtype: torch.dtype,
    geometry: Geometry,
    space: Sequence[str] = PATIENT,
    pairs: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """As `_write_volume`, to raw NRRD, from consecutive sheets shaped (k, j, i); no more are held than come at once.

    `space` has the lines that name the physical axes; `pairs` are keys and values for the header, each of one line.
    """
    header, apart = _nrrd_header(path, dtype, geometry, space, pairs), extension_of(path) in HEADERS
    voxels = path.with_suffix(".raw").name if apart else path.name
    with _appearing_whole(path) as folder, (folder / voxels).open("wb") as file:
        if apart:
            (folder / path.name).write_bytes(header + f"data file: {voxels}\n".encode())
        else:
            file.write(header + b"\n")
        for some in sheets:
            file.write(some.contiguous().numpy().data)


def _nrrd_header(
    path: Path, dtype: torch.dtype, geometry: Geometry, space: Sequence[str], pairs: Mapping[str, str]
) -> bytes:
    if dtype not in NRRD_TYPES:
        raise BadInput(f"{path}: voxels of type {dtype} are no numbers that NRRD holds; convert them")
    steps = [matrices.column(geometry.index_to_physical, axis) for axis in range(3)]
    lines = (
        "NRRD0005",
        f"type: {NRRD_TYPES[dtype]}",
        "dimension: 3",
        *space,
        "sizes: " + " ".join(str(size) for size in geometry.dims),
        "space directions: " + " ".join(_nrrd_vector(step) for step in steps),
        "kinds: domain domain domain",
        f"endian: {sys.byteorder}",
        "encoding: raw",
        f"space origin: {_nrrd_vector(geometry.origin)}",
        *(f"{key}:={_escaped(value)}" for key, value in pairs.items()),
    )
    return "\n".join((*lines, "")).encode()


def _escaped(value: str) -> str:
    """As it stands in NRRD's line."""
    return value.replace("\\", "\\\\").replace("\n", "\\n")


def _ends_as_gzip_of(path: Path, size: int) -> bool:
    """Whether a gzip is whole: it ends with how many bytes it unpacks to, modulo 2^32."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 4, 0))
        return int.from_bytes(file.read(), "little") == size % (1 << 32)


def _nrrd_vector(vector: Vector) -> str:
    return "(" + ",".join(repr(float(component)).removesuffix(".0") for component in vector) + ")"


def _system_reason(folder: Path) -> str:
    """Why nothing more can be written into the folder, in the system's words; "" if it can. SimpleITK does not say."""
    try:
        with (folder / "more").open("wb", buffering=0) as file:
            file.write(bytes(TRIED_BYTES))
            os.fsync(file.fileno())
    except OSError as error:
        return os.strerror(error.errno or 0)
    return ""


@contextmanager
def _appearing_whole(path: Path) -> Iterator[Path]:
    """A folder for files that take their places beside `path` once all are written. Raises BadInput for OSError."""
    folder = temporary_name(path.parent / "volume")  # so that the renaming stays within one file system
    try:
        folder.mkdir(mode=0o700)
        yield folder
        # The header last: who finds it finds its data.
        for written in sorted(folder.iterdir(), key=lambda file: file.name == path.name):
            take_mode(written, path.parent / written.name)
            os.replace(written, path.parent / written.name)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({os.strerror(error.errno or 0)}); choose another place") from None
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _placed(image: Any, geometry: Geometry) -> Any:
    """SimpleITK's `image` with its place in space."""
    spacing = geometry.spacing
    image.SetSpacing(spacing)
    image.SetOrigin(geometry.origin)
    image.SetDirection([row[axis] / spacing[axis] for row in geometry.index_to_physical for axis in range(3)])
    return image


def _shear(geometry: Geometry) -> float:
    """The greatest cosine between two grid axes."""
    axes = [matrices.normalised(matrices.column(geometry.index_to_physical, axis)) for axis in range(3)]
    return max(abs(matrices.dot(axes[a], axes[b])) for a, b in ((0, 1), (0, 2), (1, 2)))
