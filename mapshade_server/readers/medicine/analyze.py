"""Analyze 7.5, a .hdr of 348 bytes and an .img beside it (eeg.sourceforge.net/ANALYZE75.pdf).

NIfTI grew out of it and says more: what Analyze does not say is where left and right are.
"""

from pathlib import Path

from volsplat.mapshade_server.readers.medicine import nifti
from volsplat.mapshade_server.readers.medicine.nifti_header import HEADER_BYTES, NiftiHeader
from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.mapshade_server.readers.reading.gzip_files import first_bytes
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

BYTE_ORDERS = {b"\x5c\x01\0\0": "<", b"\0\0\x01\x5c": ">"}
SCALAR_TYPES = {2: "uint8", 4: "int16", 8: "int32", 16: "float32", 64: "float64"}
NO_SIDES = "Analyze 7.5 states no orientation: left and right, front and back cannot be told from this file"


def recognises(head: bytes) -> bool:
    return head[:4] in BYTE_ORDERS and len(head) >= HEADER_BYTES[0] and not nifti.recognises(head)


def open_image(path: Path, part: str) -> OpenedVolume:
    """The reader for the .hdr that belongs to an .img, of Analyze or NIfTI. Raises BadInput if there is none."""
    header = path.with_suffix(".HDR" if path.suffix.isupper() else ".hdr")
    if not header.is_file():
        raise BadInput(f"{path}: voxels without their header; put {header.name} beside it")
    head = first_bytes(header, HEADER_BYTES[2])
    if nifti.recognises(head):
        return nifti.open_nifti(header, part)
    if recognises(head):
        return open_analyze(header, part)
    raise BadInput(f"{path}: {header.name} beside it is no header of Analyze or NIfTI; give the volume another way")


def open_analyze(path: Path, part: str) -> OpenedVolume:
    """The reader for an Analyze header and the frame that is named if there are several.

    Raises BadInput if the header cannot be used or promises more than the .img holds.
    """
    raw = first_bytes(path, HEADER_BYTES[0])
    header = NiftiHeader(path, raw, 0, BYTE_ORDERS[raw[:4]])
    name, (voxels,), _, _ = header.voxels(part, SCALAR_TYPES)
    description = VolumeDescription(
        name=name,
        format="Analyze 7.5",
        geometry=checked_geometry(path, voxels.dims, [abs(step) for step in header.values("pixdim")[1:4]]),
        scalar_type=voxels.dtype.name,
        unit="mm" if _text(raw[56:60]).lower() == "mm" else "",
        value_unit=_text(raw[60:68]),
        warnings=(NO_SIDES,),
        **voxels.access,
    )
    return OpenedVolume(description, voxels.read, voxels.files, parts=())


def _text(raw: bytes) -> str:
    """The text before the first NUL, "" if it is no plain text."""
    text = raw.partition(b"\0")[0].decode("latin-1").strip()
    return text if text.isascii() and text.isprintable() else ""


FORMATS = (
    VolumeFormat("Analyze 7.5 (.hdr, .img)", open_analyze, recognises, gzip=True, parts=False),
    VolumeFormat("Analyze or NIfTI voxels (.img)", open_image, extensions=(".img",), gzip=True, parts=False),
)
