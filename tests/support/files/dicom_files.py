"""DICOM files for the tests of readers, made with pydicom: plain slices and multi-frame files of the enhanced kind."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pydicom
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sequence import Sequence as Items
from pydicom.uid import UID

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels

CT, MR, PET, SECONDARY, NUCLEAR = (f"1.2.840.10008.5.1.4.1.1.{n}" for n in ("2", "4", "128", "7", "20"))
ENHANCED_MR = "1.2.840.10008.5.1.4.1.1.4.1"
STRUCTURED_REPORT = "1.2.840.10008.5.1.4.1.1.88.11"
LITTLE, BIG = "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2"
RLE = "1.2.840.10008.1.2.5"
AXIAL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def head(kind: str = CT, syntax: str = LITTLE, **tags: Any) -> Dataset:
    one = Dataset()
    one.file_meta = FileMetaDataset()
    one.file_meta.TransferSyntaxUID = UID(syntax)
    one.SOPClassUID, one.SOPInstanceUID = kind, pydicom.uid.generate_uid()
    one.StudyInstanceUID, one.SeriesInstanceUID, one.Modality = "1.2.3", "1.2.3.4", "CT"
    for name, value in tags.items():
        setattr(one, name, value)
    return one


def with_pixels(one: Dataset, values: Voxels, bits_stored: int = 0) -> Dataset:
    """Adds pixels of any plain type; (frame, j, i) or (j, i)."""
    kind = values.dtype
    one.Rows, one.Columns = values.shape[-2:]
    one.SamplesPerPixel, one.PhotometricInterpretation = 1, "MONOCHROME2"
    one.BitsAllocated = kind.itemsize * 8
    one.BitsStored = bits_stored or kind.itemsize * 8
    one.HighBit = one.BitsStored - 1
    one.PixelRepresentation = int(kind.kind == "i")
    if values.ndim == 3:
        one.NumberOfFrames = len(values)
    order: Literal["<", ">"] = ">" if one.file_meta.TransferSyntaxUID == BIG else "<"
    one.PixelData = values.astype(kind.newbyteorder(order)).tobytes()
    one["PixelData"].VR = "OW"
    return one


def saved(path: Path, one: Dataset) -> Path:
    if one.file_meta.TransferSyntaxUID == RLE:
        one.file_meta.TransferSyntaxUID = UID(LITTLE)
        one.compress(RLE)
    little = one.file_meta.TransferSyntaxUID != BIG
    pydicom.dcmwrite(path, one, enforce_file_format=True, implicit_vr=False, little_endian=little)
    return path


def slice_file(
    path: Path,
    values: Voxels,
    position: Sequence[float],
    orientation: Sequence[float] = AXIAL,
    spacing: Sequence[float] = (0.75, 0.5),
    **tags: Any,
) -> Path:
    """One plain slice; `spacing` is between rows, then between columns."""
    kind, syntax = tags.pop("kind", CT), tags.pop("syntax", LITTLE)
    one = head(kind, syntax, **tags)
    one.ImagePositionPatient = [round(float(x), 6) for x in position]
    one.ImageOrientationPatient = [round(float(x), 8) for x in orientation]
    one.PixelSpacing = list(spacing)
    return saved(path, with_pixels(one, values))


def series(folder: Path, values: Voxels, heights: Sequence[float] | None = None, **tags: Any) -> Path:
    """Axial slices at `heights` mm, 3 mm apart if none are given; names say nothing of their order."""
    folder.mkdir(exist_ok=True, parents=True)
    uid = tags.get("SeriesInstanceUID", "1.2.3.4")
    for n, plane in enumerate(values):
        height = 3.0 * n if heights is None else heights[n]
        slice_file(folder / f"{uid}_{(n * 7) % 11}_{n}", plane, (-10, 20, height), **tags)
    return folder


def item(**tags: Any) -> Dataset:
    one = Dataset()
    for name, value in tags.items():
        setattr(one, name, value)
    return one


def macro(group: str, **tags: Any) -> dict[str, Items]:
    """A functional group of one item."""
    return {group: Items([item(**tags)])}


def enhanced(
    path: Path,
    values: Voxels,
    positions: Sequence[Sequence[float]],
    groups: Sequence[Mapping[str, Items]] = (),
    shared: Mapping[str, Items] | None = None,
    **tags: Any,
) -> Path:
    """A multi-frame file: each frame's position, and more `groups` of each; directions and steps are shared."""
    one = head(tags.pop("kind", ENHANCED_MR), tags.pop("syntax", LITTLE), **({"Modality": "MR"} | tags))
    common = (
        macro("PlaneOrientationSequence", ImageOrientationPatient=list(AXIAL))
        | macro("PixelMeasuresSequence", PixelSpacing=[0.75, 0.5], SliceThickness=2.0)
        | dict(shared or {})
    )
    frames = []
    for n, position in enumerate(positions):
        place = macro("PlanePositionSequence", ImagePositionPatient=[float(x) for x in position])
        frames.append(item(**place, **(groups[n] if groups else {})))
    one.SharedFunctionalGroupsSequence = Items([item(**common)])
    one.PerFrameFunctionalGroupsSequence = Items(frames)
    return saved(path, with_pixels(one, values))


def without_preambles(folder: Path) -> Path:
    """Its files as the oldest are, which begin with their first element."""
    for path in folder.iterdir():
        whole = path.read_bytes()
        path.write_bytes(whole[whole.index(b"\x08\x00\x16\x00UI") :])
    return folder


def numbered(count: int, dims: tuple[int, int] = (7, 6), first: int = 0) -> Voxels:
    """`count` planes of (i, j) `dims`, every pixel different."""
    size = dims[0] * dims[1]
    return (np.arange(count * size, dtype=np.int16) + first).reshape(count, dims[1], dims[0])
