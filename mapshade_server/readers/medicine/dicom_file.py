"""What one DICOM file says of itself and of each of its frames, through pydicom.

A plain slice is a file of one frame. In a multi-frame file of the enhanced kinds each frame has functional groups of
its own, or shares them; what is in neither is asked of the file as a whole. No pixels are read here.
"""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np

from volsplat.mapshade_server.readers.medicine.dicom_pixels import Pixels, fragments_from
from volsplat.mapshade_server.readers.medicine.dicom_values import (
    FUNCTIONAL_GROUPS,
    Rescale,
    rescale_of,
    value_unit_of,
    words_of,
)
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.grids import PALETTE_LEFT_OUT
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

PREAMBLE = 128
FIRST_TAGS = tuple(b"\x08\0" + element + b"\0" for element in (b"\x00", b"\x01", b"\x05", b"\x08", b"\x16"))
MEDIA_DIRECTORY = "1.2.840.10008.1.3.10"
UNDEFINED_LENGTH = 0xFFFFFFFF
MOST_FRAMES = 1 << 16  # of a file; what is known of each is held
PIXEL_DATA, FLOAT_PIXELS, DOUBLE_PIXELS = 0x7FE00010, 0x7FE00008, 0x7FE00009
DEFLATED = "1.2.840.10008.1.2.1.99"
SQUARE_TOLERANCE = 0.01  # of direction cosines
AXIAL_TOLERANCE = 1e-4  # likewise
Z_TOLERANCE = 0.01  # mm; of numbers that are written with few decimals

# What tells frames at one place apart: the word by which a person chooses, and where the value is found, first to
# last: in a functional group, or one within it, or in the file as a whole.
APART = {
    "stack": (("FrameContentSequence", "StackID"),),
    "echo": (("", "EchoNumbers"),),
    "te": (("MREchoSequence", "EffectiveEchoTime"), ("", "EchoTime")),
    "time": (("FrameContentSequence", "TemporalPositionIndex"), ("", "TemporalPositionIdentifier")),
    "trigger": (("CardiacSynchronizationSequence", "NominalCardiacTriggerDelayTime"), ("", "TriggerTime")),
    "phase": (("CardiacSynchronizationSequence", "NominalPercentageOfCardiacPhase"),),
    "start": (("", "FrameReferenceTime"),),
    "b": (("MRDiffusionSequence", "DiffusionBValue"), ("", "DiffusionBValue")),
    "type": (
        ("MRImageFrameTypeSequence", "FrameType"),
        ("CTImageFrameTypeSequence", "FrameType"),
        ("PETFrameTypeSequence", "FrameType"),
        ("", "ImageType"),
    ),
    "acquisition": (("FrameContentSequence", "FrameAcquisitionNumber"), ("", "AcquisitionNumber")),
    "inversion": (("MRModifierSequence", "InversionTimes"), ("", "InversionTime")),
    "flip": (("MRTimingAndRelatedParametersSequence", "FlipAngle"), ("", "FlipAngle")),
    "gradient": (
        ("MRDiffusionSequence/DiffusionGradientDirectionSequence", "DiffusionGradientOrientation"),
        ("", "DiffusionGradientOrientation"),
    ),
    "acquired": (("FrameContentSequence", "FrameAcquisitionDateTime"), ("", "AcquisitionTime")),
    "content": (("", "ContentTime"),),
}
CLOCKS = ("acquired", "content")  # which also tell the slices of one volume apart, on many scanners


@dataclass(frozen=True)
class Place:
    """Where a frame lies in the patient."""

    position: Vector
    row_direction: Vector  # along which the column index grows
    column_direction: Vector

    @property
    def normal(self) -> Vector:
        return matrices.cross(self.row_direction, self.column_direction)


@dataclass(frozen=True)
class Frame:
    """One 2-D image of a file. `place` is None if the file states none; then `spacing` may be zeros."""

    pixels: Pixels
    number: int
    place: Place | None
    spacing: tuple[float, float]  # mm between rows, then between columns, as the tag has it
    thickness: float  # mm; 0 if none is stated
    between_slices: float  # likewise
    rescale: Rescale
    apart: dict[str, tuple[str, ...]]

    @property
    def name(self) -> str:
        return f"{self.pixels.path.name} frame {self.number}" if self.pixels.frames > 1 else self.pixels.path.name

    def read(self, box: Box) -> Voxels:
        """The meant values of the box's rectangle, (j, i), NaN where there are none."""
        return self.rescale.of(self.pixels.read(self.number, box))


@dataclass(frozen=True)
class DicomFile:
    """One file of images: which series it belongs to, and its frames."""

    path: Path
    series_uid: str
    series_number: str
    series_description: str
    modality: str
    localizer: bool
    ordered: bool  # frames without places follow each other through a volume
    value_unit: str
    told: tuple[str, ...]  # what is left out of it
    frames: tuple[Frame, ...]
    refusal: str  # why its pixels cannot be read, "" if they can; then it has no frames


def recognises(head: bytes) -> bool:
    return head[PREAMBLE : PREAMBLE + 4] == b"DICM"


def recognises_old(head: bytes) -> bool:
    """Whether these may be the first bytes of a DICOM file without a preamble, as the oldest are."""
    return head[:4] in FIRST_TAGS and (head[4:6].isalpha() or head[6:8] == b"\0\0")


def dicom_file(path: Path) -> DicomFile | None:
    """What a DICOM file says; None if it holds no image, but a report, a plan or an index.

    Raises BadInput if it is damaged or truncated.
    """
    pydicom = library("pydicom", "DICOM")
    try:
        with opened(path) as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of values that are against the standard: those that matter are checked
            head = pydicom.dcmread(file, stop_before_pixels=True, force=True)
            return _told(path, head, file)
    except (BadInput, OSError):
        raise
    except Exception as error:  # of a damaged header pydicom makes anything
        raise BadInput(
            f"{path}: a DICOM file that cannot be parsed, likely truncated ({error}); fetch it again or remove it"
        ) from None


def _told(path: Path, head: Any, file: BinaryIO) -> DicomFile | None:
    kind = str(getattr(head.get("SOPClassUID"), "name", ""))
    if "Rows" not in head:
        if kind and "Image Storage" not in kind or head.file_meta.get("MediaStorageSOPClassUID") == MEDIA_DIRECTORY:
            return None
        raise BadInput(f"{path}: a DICOM file that ends before its image, likely truncated; fetch or remove it")
    refusal = _refusal(path, head)
    frames: tuple[Frame, ...] = ()
    if not refusal:
        pixels = _pixels(path, head, file)
        pixels.check_file()
        frames = tuple(_frame(path, head, pixels, number) for number in range(pixels.frames))
    modality = str(head.get("Modality", ""))
    return DicomFile(
        path=path,
        series_uid=str(head.get("SeriesInstanceUID", "")),
        series_number=str(head.get("SeriesNumber", "") or ""),
        series_description=str(head.get("SeriesDescription", "") or "").strip(),
        modality=modality,
        localizer="LOCALIZER" in words_of(head.get("ImageType")),
        ordered=head.get("VolumetricProperties") == "VOLUME" or head.get("MRAcquisitionType") == "3D",
        value_unit=value_unit_of(head, modality),
        told=(PALETTE_LEFT_OUT,) if head.get("PhotometricInterpretation") == "PALETTE COLOR" else (),
        frames=frames,
        refusal=refusal,
    )


def _refusal(path: Path, head: Any) -> str:
    """Why the file's pixels cannot be read, "" if they can."""
    samples, bits = int(head.get("SamplesPerPixel", 1)), int(head.get("BitsAllocated", 0))
    if samples != 1:
        colours = head.get("PhotometricInterpretation", "colour")
        return (
            f"{path}: has {samples} samples a pixel ({colours}), volsplat needs one number a voxel; "
            "export one component or its magnitude"
        )
    if bits not in (8, 16, 32, 64):
        return f"{path}: has {bits}-bit pixels, which volsplat does not read; save it as 16-bit"
    if "MOSAIC" in words_of(head.get("ImageType")):
        return f"{path}: is a mosaic of slices as Siemens makes them; convert the series, as with dcm2niix"
    if head.file_meta.get("TransferSyntaxUID", "") == DEFLATED:
        return f"{path}: is deflated as a whole; save it uncompressed, as with dcmconv +te"
    return ""


def _pixels(path: Path, head: Any, file: BinaryIO) -> Pixels:
    bits = int(head.BitsAllocated)
    implicit, little = head.original_encoding
    syntax = head.file_meta.get("TransferSyntaxUID", "")
    element = file.read(8 if implicit else 12)
    order: Literal["little", "big"] = "little" if little else "big"
    tag = int.from_bytes(element[:2], order) << 16 | int.from_bytes(element[2:4], order)
    kind = {PIXEL_DATA: "i" if head.get("PixelRepresentation") == 1 else "u", FLOAT_PIXELS: "f", DOUBLE_PIXELS: "f"}
    if tag not in kind:
        raise BadInput(f"{path}: a DICOM file without its pixels, likely truncated; fetch it again or remove it")
    if bits == 8 and not little and element[4:6] == b"OW":
        raise BadInput(f"{path}: has 8-bit pixels in words of big endian; save it as explicit little endian")
    packed = int.from_bytes(element[-4:], order) == UNDEFINED_LENGTH
    offset = file.tell()
    stored = int(head.get("BitsStored", bits)) if kind[tag] != "f" else bits
    pixels = Pixels(
        path=path,
        columns=int(head.Columns),
        rows=int(head.Rows),
        frames=max(int(head.get("NumberOfFrames", 1) or 1), 1),
        dtype=np.dtype(f"{'<' if little else '>'}{kind[tag]}{bits // 8}"),
        bits_stored=stored,
        high_bit=int(head.get("HighBit", stored - 1)),
        offset=offset,
        transfer_syntax=str(syntax),
        syntax_name=str(getattr(syntax, "name", syntax)),
        fragments=tuple(fragments_from(path, file)) if packed else (),
    )
    if min(pixels.columns, pixels.rows) < 1 or not 0 < pixels.bits_stored <= pixels.high_bit + 1 <= bits:
        raise BadInput(f"{path}: its numbers of rows, columns or bits make no sense; export it again")
    if pixels.frames > MOST_FRAMES:
        raise BadInput(
            f"{path}: promises {pixels.frames} frames, and no more than {MOST_FRAMES} are read of one file; "
            "export it in parts"
        )
    if packed and len(pixels.fragments) < pixels.frames:
        raise BadInput(f"{path}: promises {pixels.frames} frames and holds {len(pixels.fragments)}; export it again")
    return pixels


def _frame(path: Path, head: Any, pixels: Pixels, number: int) -> Frame:
    groups = [head[name].value for name in FUNCTIONAL_GROUPS if name in head]
    items = [group[number if len(group) == pixels.frames else 0] for group in groups if len(group)]

    def value(group: str, name: str) -> Any:
        """The frame's own value, else that which frames share, else that of the file."""
        inner = (_inside(item, group) for item in items if group)
        found = next((one for one in inner if one is not None and name in one), head)
        return found.get(name)

    spacing, place = _spacing(value), _place(path, value, head, number)
    if place is not None and not any(spacing):
        raise BadInput(f"{path}: has no usable PixelSpacing; export it again")
    return Frame(
        pixels=pixels,
        number=number,
        place=place,
        spacing=spacing,
        thickness=_numbers(value("PixelMeasuresSequence", "SliceThickness"), 1)[0],
        between_slices=_numbers(value("PixelMeasuresSequence", "SpacingBetweenSlices"), 1)[0],
        rescale=rescale_of(path, value, head),
        apart={key: found for key, sources in APART.items() if (found := _first(value, sources))},
    )


def _inside(item: Any, group: str) -> Any:
    """The data set that lies in an item under the names of sequences, None if there is none."""
    for name in group.split("/"):
        if name not in item or not len(item[name].value):
            return None
        item = item[name][0]
    return item


def _first(value: Callable[[str, str], Any], sources: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    return next((words for group, name in sources if (words := words_of(value(group, name)))), ())


def _numbers(value: Any, count: int) -> tuple[float, ...]:
    """The finite numbers of a value, as many zeros if it has another count."""
    words = words_of(value)
    numbers = tuple(float(one) for one in ([value] if isinstance(value, str | int | float) else list(value or ())))
    usable = len(words) == count and all(math.isfinite(number) for number in numbers)
    return numbers if usable else (0.0,) * count


def _spacing(value: Callable[[str, str], Any]) -> tuple[float, float]:
    """Zeros if none is stated that can be used."""
    try:
        between_rows, between_columns = _numbers(value("PixelMeasuresSequence", "PixelSpacing"), 2)
    except ValueError:  # what stands there are no numbers
        return 0.0, 0.0
    return (between_rows, between_columns) if min(between_rows, between_columns) > 0 else (0.0, 0.0)


def _place(path: Path, value: Callable[[str, str], Any], head: Any, number: int) -> Place | None:
    position = value("PlanePositionSequence", "ImagePositionPatient")
    directions = value("PlaneOrientationSequence", "ImageOrientationPatient")
    if position is None and directions is None:
        return _by_detector(path, head, number)
    return _in_grid(path, _stated_place(path, position, directions), head.get("GridFrameOffsetVector"), number)


def _stated_place(path: Path, position: Any, directions: Any) -> Place:
    if len(words_of(position)) != 3:
        raise BadInput(f"{path}: has no usable ImagePositionPatient, so it has no place in a series; export it again")
    x, y, z = _numbers(position, 3)
    numbers = _numbers(directions, 6)
    row, column = (numbers[0], numbers[1], numbers[2]), (numbers[3], numbers[4], numbers[5])
    square = (matrices.length(row) - 1, matrices.length(column) - 1, matrices.dot(row, column))
    if max(abs(error) for error in square) > SQUARE_TOLERANCE:
        raise BadInput(
            f"{path}: has no usable ImageOrientationPatient, so it has no place in a series; export it again"
        )
    return Place((x, y, z), row, column)


def _by_detector(path: Path, head: Any, number: int) -> Place | None:
    """The place of a frame of reconstructed nuclear medicine, which states that of the first slice and their distance.

    A distance below 0 leads against the normal (PS3.3, C.8.4.15).
    """
    detector: Any = next(iter(head.get("DetectorInformationSequence") or ()), {})
    position, directions = detector.get("ImagePositionPatient"), detector.get("ImageOrientationPatient")
    (step,) = _numbers(head.get("SpacingBetweenSlices"), 1)
    slices = _listed(head.get("SliceVector"))
    if not (words_of(position) and words_of(directions) and step and slices):
        return None
    if len(slices) <= number:
        raise BadInput(f"{path}: its SliceVector has no place for frame {number}; export it again")
    first = _stated_place(path, position, directions)
    along = matrices.scaled(first.normal, step * (int(slices[number]) - 1))
    return replace(first, position=matrices.plus(first.position, along))


def _listed(value: Any) -> Sequence[Any]:
    """A value's parts as they are, since words of a part for each frame would be made for each frame."""
    return value if isinstance(value, Sequence) and not isinstance(value, str) else words_of(value)


def _in_grid(path: Path, place: Place, stated: Any, number: int) -> Place:
    """The place of a dose grid's frame: its offset along the normal counts from the first frame, or is z itself."""
    offsets = _listed(stated)
    if not offsets:
        return place
    if len(offsets) <= number:
        raise BadInput(f"{path}: its GridFrameOffsetVector has no place for frame {number}; export it again")
    first, offset, z = float(offsets[0]), float(offsets[number]), place.position[2]
    if first == 0:
        return replace(place, position=matrices.plus(place.position, matrices.scaled(place.normal, offset)))
    upright = place.normal[2]
    if abs(abs(upright) - 1) > AXIAL_TOLERANCE or abs(first - z) > Z_TOLERANCE:
        raise BadInput(
            f"{path}: its GridFrameOffsetVector begins with {first:g}, which is neither 0 nor, of an axial grid, the z "
            f"of its ImagePositionPatient ({z:g}); export it again"
        )
    along = matrices.scaled(place.normal, (offset - first) / upright)
    return replace(place, position=matrices.plus(place.position, along))
