"""Opens a volume with the reader that knows its content. A new format is one more line of a table."""

import errno
import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from volsplat.mapshade_server.readers.reading.file_marks import HEAD_BYTES, check_is_file, mark_of, told_head
from volsplat.mapshade_server.readers.reading.gzip_files import DAMAGED_GZIP, GZIP_MAGIC
from volsplat.mapshade_server.readers.reading.headers_beside import header_naming
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput

LOCAL_URL = "file://"
SHORT_EXAMPLE = "dims=256x256x113,type=uint16"  # of raw voxels


class _Reader:
    """A reader's module, imported when one of its functions is called: each takes time, and few are ever needed."""

    def __init__(self, module: str) -> None:
        self._module = f"{__package__}.{module}"

    def __getattr__(self, function: str) -> Callable[..., Any]:
        def called(*given: Any) -> Any:
            return getattr(import_module(self._module), function)(*given)

        return called


if TYPE_CHECKING:
    from volsplat.mapshade_server.readers.arrays import (
        hdf5_dataset,
        netcdf_classic,
        numpy_array,
        raw_voxels,
        shared_array,
    )
    from volsplat.mapshade_server.readers.astronomy import fits_cube
    from volsplat.mapshade_server.readers.geology import segy
    from volsplat.mapshade_server.readers.medicine import (
        analyze,
        dicom_series,
        metaimage,
        mgh,
        nifti,
        nrrd,
        picture_folder,
        tiff_folder,
        tiff_stack,
    )
    from volsplat.mapshade_server.readers.molecules import atoms, density_map, gaussian_cube, mmcif, structure_factors
    from volsplat.mapshade_server.readers.vtk_files import legacy_vtk, vtk_image
    from volsplat.mapshade_server.readers.zarr_arrays import zarr_store
else:
    analyze = _Reader("medicine.analyze")
    dicom_series = _Reader("medicine.dicom_series")
    metaimage = _Reader("medicine.metaimage")
    mgh = _Reader("medicine.mgh")
    nifti = _Reader("medicine.nifti")
    nrrd = _Reader("medicine.nrrd")
    picture_folder = _Reader("medicine.picture_folder")
    tiff_folder = _Reader("medicine.tiff_folder")
    tiff_stack = _Reader("medicine.tiff_stack")
    atoms = _Reader("molecules.atoms")
    density_map = _Reader("molecules.density_map")
    gaussian_cube = _Reader("molecules.gaussian_cube")
    mmcif = _Reader("molecules.mmcif")
    structure_factors = _Reader("molecules.structure_factors")
    hdf5_dataset = _Reader("arrays.hdf5_dataset")
    netcdf_classic = _Reader("arrays.netcdf_classic")
    numpy_array = _Reader("arrays.numpy_array")
    raw_voxels = _Reader("arrays.raw_voxels")
    shared_array = _Reader("arrays.shared_array")
    fits_cube = _Reader("astronomy.fits_cube")
    segy = _Reader("geology.segy")
    legacy_vtk = _Reader("vtk_files.legacy_vtk")
    vtk_image = _Reader("vtk_files.vtk_image")
    zarr_store = _Reader("zarr_arrays.zarr_store")


Open = Callable[[Path, str], OpenedVolume]  # given the part that is named, "" for none


@dataclass(frozen=True)
class VolumeFormat:
    """A format of files: `recognises` gets a file's first bytes, unzipped if the file is gzip.

    If no format recognises a file, the extension decides among those that have no mark of their own.
    """

    name: str  # with the usual extensions, as messages call it
    open: Open
    recognises: Callable[[bytes], bool] = lambda head: False
    extensions: tuple[str, ...] = ()
    gzip: bool = False  # read also if gzip has packed the file as a whole
    parts: bool = False  # a file may hold several volumes, which its header tells


@dataclass(frozen=True)
class FolderFormat:
    """A format of folders; the first that recognises one has it."""

    name: str
    open: Open
    recognises: Callable[[Path], bool]


def _packed_or_not(*extensions: str) -> tuple[str, ...]:
    return tuple(name + packed for name in extensions for packed in ("", ".gz"))


DICOM = VolumeFormat("DICOM series (a folder)", dicom_series.open_dicom_file, dicom_series.recognises)
RAW = VolumeFormat("raw voxels (.raw)", raw_voxels.open_raw_voxels, extensions=_packed_or_not(".raw"), gzip=True)
FORMATS = (
    VolumeFormat("NRRD (.nrrd, .nhdr)", nrrd.open_nrrd, nrrd.recognises, parts=True),
    VolumeFormat("MetaImage (.mha, .mhd)", metaimage.open_metaimage, metaimage.recognises, parts=True),
    VolumeFormat("NIfTI (.nii, .nii.gz)", nifti.open_nifti, nifti.recognises, gzip=True, parts=True),
    # Early, since the modules of all formats before a file's own are imported, and astropy alone takes long enough.
    VolumeFormat("FITS cube (.fits, .fits.gz)", fits_cube.open_fits_cube, fits_cube.recognises, gzip=True, parts=True),
    VolumeFormat("Analyze 7.5 (.hdr, .img)", analyze.open_analyze, analyze.recognises, gzip=True),
    VolumeFormat("Analyze or NIfTI voxels (.img)", analyze.open_image, extensions=(".img",), gzip=True),
    VolumeFormat(
        "FreeSurfer (.mgh, .mgz)", mgh.open_mgh, extensions=(".mgh", ".mgz", ".mgh.gz"), gzip=True, parts=True
    ),
    # Before TIFF, since a DICOM file may bear TIFF's magic in its preamble.
    DICOM,
    VolumeFormat("TIFF stack (.tif, .ome.tif)", tiff_stack.open_tiff_stack, tiff_stack.recognises, parts=True),
    VolumeFormat(
        "PDB or PQR coordinates (.pdb, .pqr)",
        atoms.open_pdb,
        atoms.recognises,
        _packed_or_not(".pdb", ".ent", ".pqr"),
        gzip=True,
        parts=True,
    ),
    VolumeFormat(
        "mmCIF (.cif)", mmcif.open_mmcif, mmcif.recognises, _packed_or_not(".cif", ".mmcif"), gzip=True, parts=True
    ),
    VolumeFormat(
        "MTZ structure factors (.mtz)",
        structure_factors.open_mtz,
        structure_factors.recognises,
        gzip=True,
        parts=True,
    ),
    VolumeFormat(
        "CCP4/MRC map (.map, .mrc)",
        density_map.open_density_map,
        density_map.recognises,
        _packed_or_not(".mrc", ".mrcs", ".map", ".ccp4"),  # files from before 2000 have no mark
        gzip=True,
        parts=True,
    ),
    VolumeFormat("SEG-Y survey (.sgy, .segy)", segy.open_segy, extensions=(".sgy", ".segy")),
    VolumeFormat(
        "Gaussian cube (.cube)",
        gaussian_cube.open_gaussian_cube,
        extensions=_packed_or_not(".cube", ".cub"),
        gzip=True,
        parts=True,
    ),
    VolumeFormat("HDF5 dataset (.h5, .nxs)", hdf5_dataset.open_hdf5, hdf5_dataset.recognises, parts=True),
    VolumeFormat("NetCDF-3 (.nc)", netcdf_classic.open_netcdf_classic, netcdf_classic.recognises, parts=True),
    VolumeFormat("NumPy array (.npy)", numpy_array.open_npy, numpy_array.recognises, parts=True),
    VolumeFormat("NumPy arrays (.npz)", numpy_array.open_npz, numpy_array.recognises_npz, parts=True),
    VolumeFormat("VTK image or grid (.vti, .vtr)", vtk_image.open_vtk_image, vtk_image.recognises, parts=True),
    VolumeFormat("VTK image or grid (.vtk)", legacy_vtk.open_legacy_vtk, legacy_vtk.recognises, parts=True),
    VolumeFormat(
        "Zarr (.zarr, .zarr.zip)", zarr_store.open_zip, zarr_store.recognises_zip, (".zip", ".ozx"), parts=True
    ),
    VolumeFormat("array in memory", shared_array.open_shared_array, shared_array.recognises),
    RAW,
)

FOLDER_FORMATS = (
    FolderFormat("Zarr", zarr_store.open_folder, zarr_store.recognises_folder),
    FolderFormat("TIFF slices", tiff_folder.open_tiff_folder, tiff_folder.recognises_folder),
    FolderFormat("pictures", picture_folder.open_picture_folder, picture_folder.recognises_folder),
    FolderFormat("DICOM series", dicom_series.open_folder, lambda folder: True),
)


def open_volume(name: str) -> OpenedVolume:
    """The reader for the file, folder, URL or part of one that is named, chosen by its content.

    Raises BadInput if there is nothing, if the format is unknown, and if the header is not that of a
    volume or promises more than the file holds.
    """
    place, part = volume_name(name)
    if place.startswith(LOCAL_URL):
        place = unquote(place.removeprefix(LOCAL_URL))
    elif volume_name(name).is_url:
        return zarr_store.open_url(place, part)  # the only format that is read over networks
    try:
        return _opened(Path(place), part)
    except FileNotFoundError:
        raise BadInput(f"{place}: there is no such file; check the path") from None
    except OSError as error:
        which, reason = error.filename or place, os.strerror(error.errno or 0)
        raise BadInput(f"{which}: cannot be read ({reason}); check its permissions and its disk") from None


def format_of(path: Path, head: bytes) -> VolumeFormat | None:
    """The format of a file with these first bytes, by its content, else by its extension; None for no known one."""
    by_content = (one for one in FORMATS if one.recognises(head))
    by_extension = (one for one in FORMATS if path.name.lower().endswith(one.extensions))
    return next(by_content, None) or next(by_extension, None)


def _opened(path: Path, part: str) -> OpenedVolume:
    check_is_file(path)
    if path.is_dir():
        if not os.access(path, os.X_OK):  # else what is looked for in it would be named, which need not be there
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return next(one for one in FOLDER_FORMATS if one.recognises(path)).open(path, part)
    packed, head = head_of(path)
    if not head:
        raise BadInput(f"{path}: the file is empty; fetch or export the volume again")
    if found := format_of(path, head):
        if packed and not found.gzip:
            raise BadInput(f"{path}: is a gzip of {found.name}, which is not read packed; unpack it by gunzip")
        return found.open(path, part)
    if raw_voxels.describes(path, part):
        return raw_voxels.open_raw_voxels(path, part)
    if not packed and dicom_series.recognises_old(head):  # the mark is too weak to go before anybody's word
        return DICOM.open(path, part)
    if head.startswith(GZIP_MAGIC):
        raise BadInput(f"{path}: {'is packed by gzip twice; unpack it by gunzip' if packed else DAMAGED_GZIP}")
    if header := header_naming(path):
        raise BadInput(f"{path}: has the voxels that {header.name} beside it describes; open that instead")
    mark, a_gzip = mark_of(head), "a gzip of " if packed else ""
    if mark is not None:
        raise BadInput(f"{path}: is {a_gzip}{mark.what}, which is not read; {mark.cure}")
    described = f"raw voxels are described as in {path.name}#{SHORT_EXAMPLE}"
    raise BadInput(f"{path}: is {a_gzip}no format that is known, it begins with {told_head(head)}; {described}")


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
