"""Opens a volume with the reader that knows its content. A new format is one more line of the table."""

import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from volsplat.mapshade_server.readers import dicom_series, metaimage, nifti, nrrd, tiff_stack
from volsplat.mapshade_server.readers.volume_reader import VolumeReader
from volsplat.protocol.errors import BadInput

HEAD_BYTES = 4096


@dataclass(frozen=True)
class VolumeFormat:
    """A format of files: `recognises` gets a file's first bytes, unzipped where the file is gzip."""

    name: str  # with the usual extensions, as a person is told of it
    recognises: Callable[[bytes], bool]
    open: Callable[[Path], VolumeReader]


FORMATS = (
    VolumeFormat("NRRD (.nrrd, .nhdr)", nrrd.recognises, nrrd.open_nrrd),
    VolumeFormat("MetaImage (.mha, .mhd)", metaimage.recognises, metaimage.open_metaimage),
    VolumeFormat("NIfTI (.nii, .nii.gz)", nifti.recognises, nifti.open_nifti),
    # Before TIFF, since a DICOM file may bear TIFF's magic in its preamble.
    VolumeFormat("DICOM series (a folder)", dicom_series.recognises, dicom_series.open_slice),
    VolumeFormat("TIFF stack (.tif)", tiff_stack.recognises, tiff_stack.open_tiff_stack),
)


def open_volume(path: str) -> VolumeReader:
    """The reader for the file or DICOM folder at `path`, chosen by its content.

    Raises BadInput where there is nothing, where the format is unknown, and where the header is not that of a
    volume or promises more than the file holds.
    """
    try:
        return _opened(Path(path))
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise BadInput(f"{path}: cannot be read ({reason}); check its permissions and its disk") from None


def _opened(path: Path) -> VolumeReader:
    if path.is_dir():
        return dicom_series.open_folder(path)
    head = _head(path)
    if not head:
        raise BadInput(f"{path}: the file is empty; fetch or export the volume again")
    for volume_format in FORMATS:
        if volume_format.recognises(head):
            return volume_format.open(path)
    known = ", ".join(volume_format.name for volume_format in FORMATS)
    raise BadInput(f"{path}: its format is not known; volumes are read from {known}")


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if head.startswith(b"\x1f\x8b"):
        try:
            return zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(head, HEAD_BYTES)
        except zlib.error:
            return head
    return head
