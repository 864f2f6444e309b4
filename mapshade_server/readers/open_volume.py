"""Opens a volume with the reader that knows its content. A new reader is one more line of a table."""

import errno
import os
import zlib
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

from volsplat.mapshade_server.readers.reading.file_marks import HEAD_BYTES, check_is_file, mark_of, told_head
from volsplat.mapshade_server.readers.reading.gzip_files import DAMAGED_GZIP, GZIP_MAGIC
from volsplat.mapshade_server.readers.reading.headers_beside import header_naming
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.volume_reader import FolderFormat, OpenedVolume, VolumeFormat
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput

SHORT_EXAMPLE = "dims=256x256x113,type=uint16"  # of raw voxels


# The readers' modules, each with its FORMATS, in the order in which these are asked whose a file is. FITS is early: all
# before a file's own are imported, and astropy alone takes long enough. DICOM's files may bear TIFF's magic in their
# preamble, so it comes before.
READERS = (
    "medicine.nrrd",
    "medicine.metaimage",
    "medicine.nifti",
    "astronomy.fits_cube",
    "medicine.analyze",
    "medicine.mgh",
    "medicine.dicom_series",
    "medicine.tiff_stack",
    "molecules.atoms",
    "molecules.mmcif",
    "molecules.structure_factors",
    "molecules.density_map",
    "geology.segy",
    "molecules.gaussian_cube",
    "arrays.hdf5_dataset",
    "arrays.netcdf_classic",
    "arrays.numpy_array",
    "vtk_files.vtk_image",
    "vtk_files.legacy_vtk",
    "zarr_arrays.zarr_store",
    "arrays.shared_array",
    "arrays.raw_voxels",
)
FOLDER_READERS = (  # likewise, each with its FOLDER_FORMAT
    "zarr_arrays.zarr_store",
    "medicine.tiff_folder",
    "medicine.picture_folder",
    "medicine.dicom_series",
)


def file_formats() -> Iterator[VolumeFormat]:
    """Each reader is imported when it is its turn: that takes time, and few are ever needed."""
    return (one for reader in READERS for one in _module(reader).FORMATS)


def folder_formats() -> Iterator[FolderFormat]:
    """Likewise."""
    return (_module(reader).FOLDER_FORMAT for reader in FOLDER_READERS)


def _module(reader: str) -> ModuleType:
    return import_module(f"{__package__}.{reader}")


def open_volume(name: str) -> OpenedVolume:
    """The reader for the file, folder, URL or part of one that is named, chosen by its content.

    Raises BadInput if there is nothing, if the format is unknown, and if the header is not that of a
    volume or promises more than the file holds.
    """
    named = volume_name(name)
    place, part = named.plain_place, named.part
    if named.is_far:
        from volsplat.mapshade_server.readers.zarr_arrays.zarr_store import open_url

        return open_url(place, part)  # the only format that is read over networks
    try:
        return _opened(Path(place), part)
    except FileNotFoundError:
        raise BadInput(f"{place}: there is no such file; check the path") from None
    except OSError as error:
        which, reason = error.filename or place, os.strerror(error.errno or 0)
        raise BadInput(f"{which}: cannot be read ({reason}); check its permissions and its disk") from None


def parts_of(name: str) -> Sequence[Part]:
    """Those that can be opened each by itself: one must be named, or may be; none if there is nothing to choose.

    Raises BadInput for what cannot be opened.
    """
    try:
        return open_volume(name).parts
    except PartNeeded as needed:
        return needed.parts


def format_of(path: Path, head: bytes) -> VolumeFormat | None:
    """The format of a file with these first bytes, by its content, else by its extension; None for no known one."""
    by_content = (one for one in file_formats() if one.recognises(head))
    by_extension = (one for one in file_formats() if path.name.lower().endswith(one.extensions))
    return next(by_content, None) or next(by_extension, None)


def _opened(path: Path, part: str) -> OpenedVolume:
    check_is_file(path)
    if path.is_dir():
        if not os.access(path, os.X_OK):  # else what is looked for in it would be named, which need not be there
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return next(one for one in folder_formats() if one.recognises(path)).open(path, part)
    packed, head = head_of(path)
    if not head:
        raise BadInput(f"{path}: the file is empty; fetch or export the volume again")
    if found := format_of(path, head):
        if packed and not found.gzip:
            raise BadInput(f"{path}: is a gzip of {found.name}, which is not read packed; unpack it by gunzip")
        return found.open(path, part)
    if (unmarked := _without_mark(path, part, b"" if packed else head)) is not None:
        return unmarked
    if head.startswith(GZIP_MAGIC):
        raise BadInput(f"{path}: {'is packed by gzip twice; unpack it by gunzip' if packed else DAMAGED_GZIP}")
    if header := header_naming(path):
        raise BadInput(f"{path}: has the voxels that {header.name} beside it describes; open that instead")
    mark, a_gzip = mark_of(head), "a gzip of " if packed else ""
    if mark is not None:
        raise BadInput(f"{path}: is {a_gzip}{mark.what}, which is not read; {mark.cure}")
    described = f"raw voxels are described as in {path.name}#{SHORT_EXAMPLE}"
    raise BadInput(f"{path}: is {a_gzip}no format that is known, it begins with {told_head(head)}; {described}")


def _without_mark(path: Path, part: str, head: bytes) -> OpenedVolume | None:
    """What is read whatever the file's name: described raw voxels, else old DICOM, whose mark is weaker than words."""
    from volsplat.mapshade_server.readers.arrays import raw_voxels
    from volsplat.mapshade_server.readers.medicine import dicom_file, dicom_series

    if raw_voxels.describes(path, part):
        return raw_voxels.open_raw_voxels(path, part)
    return dicom_series.open_dicom_file(path, part) if dicom_file.recognises_old(head) else None


def head_of(path: Path) -> tuple[bool, bytes]:
    """Whether the file is gzip, and its first bytes, unzipped if they can be."""
    with opened(path) as file:
        head = file.read(HEAD_BYTES)
    if head.startswith(GZIP_MAGIC):
        try:
            return True, zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(head, HEAD_BYTES)
        except zlib.error:
            return False, head
    return False, head
