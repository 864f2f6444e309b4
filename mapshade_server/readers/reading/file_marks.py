"""What files are that no reader takes, by the marks that they begin with: so that one line can say so.

Also what stands in the file system under a name but is no file.
"""

import stat
from pathlib import Path
from typing import NamedTuple

from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.protocol.text.errors import BadInput

UNPACK = "unpack it first"
ONE_PICTURE = "give the folder of all its slices"
MESH = "volsplat draws voxels; sample it on a grid first"
SHOWN_BYTES = 16
HEAD_BYTES = 4096


class Mark(NamedTuple):
    """Bytes at a place of a file, in any case of letters; what such a file is, and what to do with it."""

    mark: bytes
    what: str
    cure: str
    at: int = 0


class FolderMark(NamedTuple):
    """A file that such folders hold, and what its first bytes hold; what they are, and what to do with them."""

    file: str
    mark: bytes
    what: str
    cure: str


MARKS = (
    Mark(b"\x89PNG\r\n\x1a\n", "one PNG picture", ONE_PICTURE),
    Mark(b"\xff\xd8\xff", "one JPEG picture", ONE_PICTURE),
    Mark(b"\0\0\0\x0cjP  \r\n", "one JPEG 2000 picture", ONE_PICTURE),
    Mark(b"\xff\x4f\xff\x51", "one JPEG 2000 picture", ONE_PICTURE),
    Mark(b"GIF8", "a GIF picture", "save its frames as a TIFF stack"),
    Mark(b"WEBP", "one WebP picture", ONE_PICTURE, 8),
    Mark(b"\x76\x2f\x31\x01", "one OpenEXR picture", "save its slices as a TIFF stack"),
    Mark(b"PK\x03\x04", "a ZIP archive", UNPACK),
    Mark(b"PK\x05\x06", "an empty ZIP archive", "fetch it again"),
    Mark(b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    Mark(b"Rar!", "a RAR archive", UNPACK),
    Mark(b"\xfd7zXZ\0", "packed by xz", UNPACK),
    Mark(b"\x28\xb5\x2f\xfd", "packed by zstd", UNPACK),
    Mark(b"\x04\x22\x4d\x18", "packed by lz4", UNPACK),
    Mark(b"BZh", "packed by bzip2", UNPACK),
    Mark(b"ustar", "a tar archive", UNPACK, 257),
    Mark(b"%PDF", "a PDF document", "give the volume itself"),
    Mark(b"<!DOCTYPE html", "a web page, likely of a download that failed", "fetch the volume again"),
    Mark(b"<html", "a web page, likely of a download that failed", "fetch the volume again"),
    Mark(b"version https://git-lfs", "a pointer of Git LFS, not the file itself", "fetch that by git lfs pull"),
    Mark(b"\0\x05\x16\x07", "what macOS keeps beside a file", "give the file itself, without ._ before its name"),
    Mark(b" BDV", "an OpenVDB grid", "save it as a dense grid, as in NRRD or .vti"),
    Mark(b"ply\n", "a PLY mesh", MESH),
    Mark(b"ply\r", "a PLY mesh", MESH),
    Mark(b"glTF", "a glTF mesh", MESH),
    Mark(b"solid ", "an STL mesh", MESH),
    Mark(b"MATLAB 5.0 MAT-file", "a MATLAB file before version 7.3", "save it with -v7.3"),
    Mark(b"\x0e\x03\x13\x01", "HDF4", "convert it, as with h4toh5"),
    Mark(b"GRIB", "GRIB", "convert it to NetCDF, as with cdo -f nc4 copy"),
    Mark(b"PAR1", "a Parquet table", "save the volume as NumPy or Zarr"),
    Mark(b"ARROW1", "an Arrow table", "save the volume as NumPy or Zarr"),
    Mark(b"SQLite format 3\0", "an SQLite database", "export the volume from it"),
    Mark(b"\x80\x04\x95", "a Python pickle, which could run any program", "save the array by numpy.save"),
    Mark(b"ZISRAWFILE", "Zeiss CZI", "convert it to OME-TIFF, as with bfconvert"),
    Mark(b"\xda\xce\xbe\x0a", "Nikon ND2", "convert it to OME-TIFF, as with bfconvert"),
    Mark(b"p\0\0\0", "Leica LIF", "convert it to OME-TIFF, as with bfconvert"),
    Mark(b"\xd0\xcf\x11\xe0", "an OLE file, as Olympus OIB", "convert it to OME-TIFF, as with bfconvert"),
    Mark(b"# AmiraMesh", "an Amira mesh", "save it as NRRD"),
    Mark(b"# Avizo", "an Avizo mesh", "save it as NRRD"),
    Mark(b"# === DATA DESCRIPTION FILE", "a Philips PAR header", "convert it to NIfTI, as with dcm2niix"),
    Mark(b"##TITLE=", "a Bruker parameter file", "convert the study to NIfTI or DICOM"),
    Mark(b"object 1 class gridpositions", "an OpenDX map", "save it as CCP4 or .vti"),
    Mark(b"\x7fELF", "a program", "give a volume"),
    Mark(b"BM", "one BMP picture", ONE_PICTURE),
)

MARKS_OF_FOLDERS = (
    FolderMark("attributes.json", b'"n5"', "an N5 container", "save the volume as Zarr"),
    FolderMark("attributes.json", b'"dimensions"', "an N5 dataset", "save the volume as Zarr"),
    FolderMark("info", b'"scales"', "Neuroglancer's precomputed volume", "save the volume as Zarr"),
)

NO_FILES = (
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a disk"),
)


def mark_of(head: bytes) -> Mark | None:
    """What a file with these first bytes is, None if they are no mark that is known."""
    return next((one for one in MARKS if head[one.at :][: len(one.mark)].lower() == one.mark.lower()), None)


def mark_of_folder(folder: Path) -> FolderMark | None:
    """What a folder without images is, None if no file in it is known."""
    return next((one for one in MARKS_OF_FOLDERS if one.mark in _first_bytes(folder / one.file)), None)


def _first_bytes(path: Path) -> bytes:
    if not path.is_file():
        return b""
    with opened(path) as file:
        return file.read(HEAD_BYTES)


def told_head(head: bytes) -> str:
    """How a file begins, for a person: as text if it is text."""
    first = head[:SHOWN_BYTES].splitlines()[0] if head[:SHOWN_BYTES].splitlines() else b""
    return f"“{first.decode()}”" if first.isascii() and first.decode().isprintable() else head[:8].hex(" ")


def leads_nowhere(path: Path) -> bool:
    """Whether it is a link to what is not there, as git-annex and DataLad have them for what was not fetched."""
    return path.is_symlink() and not path.exists()


def check_is_file(path: Path) -> None:
    """Raises BadInput if `path` is neither file nor folder, as a FIFO, which would hang, or a link that leads nowhere.

    Raises OSError if it is not there.
    """
    if leads_nowhere(path):
        raise BadInput(
            f"{path}: is a link to {path.readlink()}, which is not there; fetch it (git annex get {path.name}), or "
            "correct the link"
        )
    mode = path.stat().st_mode
    what = next((name for kind, name in NO_FILES if kind(mode)), "")
    if what:
        raise BadInput(f"{path}: is {what}, which cannot be read in parts; copy it into a file and give that")
