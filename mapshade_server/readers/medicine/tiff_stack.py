"""TIFF stacks, one page for each slice: plain ones, ImageJ's and OME-TIFF, also BigTIFF, through tifffile.

Where a file holds several images, channels or times, the person chooses: `cells.ome.tif#series=1,c=0,t=3`.
"""

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.medicine.ome_tiff import OmeImage, OmeMetadata, StatedSteps, ome_metadata
from volsplat.mapshade_server.readers.medicine.tiff_pages import MOST_GROWTH, TiffPage, tifffile
from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.mapshade_server.readers.reading.length_units import length_unit
from volsplat.mapshade_server.readers.reading.part_options import PartOptions, index_in, part_options
from volsplat.mapshade_server.readers.reading.simple_itk import (
    checked_geometry,
    refuse_other_dimensions,
    refuse_vectors,
)
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_files import DiskFile, disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import SCALAR_TYPES, Voxels
from volsplat.mapshade_server.readers.reading.voxel_room import voxel_room
from volsplat.protocol.description.volume import Box, Index, VolumeDescription
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.text.errors import BadInput

MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
WIDER = {"bool": "uint8", "float16": "float32"}  # types that tensors of voxels do not have
WHAT_ALONG = {"C": "channels", "T": "times", "Z": "slices"}

# Dots per inch that programs write when they know nothing of the specimen.
SCREENS_AND_PRINTERS = (1, 72, 96, 100, 150, 200, 240, 300, 400, 600, 1200, 2400)
MILLIMETRES_PER = {2: 25.4, 3: 10.0}  # the TIFF tag's inch and centimetre

# Where the stored rows and columns lead, by the tag Orientation: the axis of x (0) or y (1) of i and j, and the sign.
LED_BY_ORIENTATION = {
    1: ((0, 1), (1, 1)),
    2: ((0, -1), (1, 1)),
    3: ((0, -1), (1, -1)),
    4: ((0, 1), (1, -1)),
    5: ((1, 1), (0, 1)),
    6: ((1, 1), (0, -1)),
    7: ((1, -1), (0, -1)),
    8: ((1, -1), (0, 1)),
}


def recognises(head: bytes) -> bool:
    return head[:4] in MAGICS


@dataclass(frozen=True)
class Place:
    """What a file states of its voxels' size, and what had to be guessed."""

    steps: Vector
    unit: str
    warnings: tuple[str, ...]


class TiffStackReader:
    """One volume of TIFF pages. `raw` is there where all pages are uncompressed: then only rows are read."""

    def __init__(self, description: VolumeDescription, pages: Sequence[TiffPage], raw: StoredVoxels | None) -> None:
        self._description = description
        self._pages = pages
        self._raw = raw

    def describe(self) -> VolumeDescription:
        return self._description

    @property
    def files(self) -> tuple[DiskFile, ...]:
        return disk_files([page.path for page in self._pages])

    def read(self, box: Box) -> Voxels:
        scalar_type = self._description.scalar_type
        if self._raw is not None:
            return self._raw.read(box).astype(scalar_type, copy=False)
        voxels = voxel_room(box, scalar_type, self._pages[0].path)
        opened = None
        with ExitStack() as files:
            for n, page in enumerate(self._pages[box.low[2] : box.high[2]]):
                if opened is None or opened.name != str(page.path):
                    files.close()
                    opened = files.enter_context(page.path.open("rb"))
                voxels[n] = page.read(opened, box)
        return voxels


def open_tiff_stack(path: Path, part: str) -> TiffStackReader:
    """The reader for a TIFF file and the image, channel and time of it that are named.

    Raises BadInput for truncated files, colour, pages of several sizes, and where something must be chosen.
    """
    try:
        with tifffile().TiffFile(path) as file:
            return _opened(path, part, file)
    except (BadInput, OSError):
        raise
    except Exception as error:  # of a damaged file's tags tifffile makes anything
        raise BadInput(f"{path}: is truncated or damaged ({error}); fetch or export it again") from None


def _opened(path: Path, part: str, file: Any) -> TiffStackReader:
    check_ends(path, file)
    check_set(path, file)
    ome = ome_metadata(file.ome_metadata) if file.is_ome else OmeMetadata((), "")
    every = file.series
    if every[0].kind in ("uniform", "generic") and len(every) > 1:
        page = min(series.keyframe.index for series in every[1:]) + 1
        raise BadInput(f"{path}: page {page} differs from the first in size or type; save one stack alone")
    said = part_options(part, ("series", *(axis.lower() for series in every for axis in series.axes)))
    number = _series_number(path, said, every)
    series = every[number]
    packing = series.keyframe
    if packing.samplesperpixel != 1:
        refuse_vectors(path, f"{packing.samplesperpixel} samples a pixel")
    image = ome.of(number, series.name, (packing.imagewidth, packing.imagelength))
    chosen = _chosen(path, said, series, image)
    pages = [_page(path, series, n, image) for n in chosen.pages]
    place = stated_place(file, packing, image, ome.kept_in)
    return stack_of(path, _format(file, pages), pages, place, chosen)


def check_ends(path: Path, file: Any) -> None:
    """Raises BadInput where the chain of pages breaks off; tifffile takes the pages before as all there are."""
    count = len(file.pages)
    next_page = file.pages.next_page_offset
    if count and next_page is not None:
        file.filehandle.seek(next_page)
        if not any(file.filehandle.read(file.tiff.offsetsize)):
            return
    raise BadInput(f"{path}: is truncated: its pages lie beyond its end; fetch or export it again")


def check_set(path: Path, file: Any) -> None:
    """Raises BadInput where a file that belongs to the same set is a FIFO, which tifffile would wait for."""
    told = ome_metadata(file.ome_metadata) if file.is_ome else OmeMetadata((), "")
    named = [path.parent / name for image in told.images for name in (*image.files, told.kept_in) if name]
    for other in (*named, *path.parent.glob("*.tif*")) if file.is_micromanager else named:
        if other.exists():
            check_is_file(other)


def _series_number(path: Path, said: PartOptions, every: Sequence[Any]) -> int:
    """Which image is meant: the named one, or the only one that is a volume."""
    if said.word:
        raise BadInput(f"{path}: “{said.word}” names nothing here; name image, channel or time as in {path}#c=0,t=0")
    if "series" in said.values:
        return index_in(path, said.values["series"], len(every), "images")
    volumes = [n for n, series in enumerate(every) if _slice_axis(series) is not None]
    if len(volumes) <= 1:
        return volumes[0] if volumes else 0
    shown = "; ".join(
        f"{n} “{every[n].name}” {' x '.join(str(size) for size in reversed(every[n].shape))}" for n in volumes
    )
    raise BadInput(f"{path}: holds {len(volumes)} images: {shown}; choose one, as in {path}#series={volumes[0]}")


def _slice_axis(series: Any) -> int | None:
    """Which of the series' axes is that of the slices: Z, or the only one left, as of files that name none."""
    long = [n for n, size in enumerate(series.shape[:-2]) if size > 1]
    named = [n for n in long if series.axes[n] == "Z"]
    other = [n for n in long if series.axes[n] not in "CS"]
    return next(iter([*named, *reversed(other)]), None)


@dataclass(frozen=True)
class Chosen:
    """Which pages of a series make the volume, what they are called, and what is to be told of the choice."""

    pages: Sequence[int]
    name: str = ""
    channel: str = ""
    warnings: tuple[str, ...] = ()


def _chosen(path: Path, said: PartOptions, series: Any, image: OmeImage | None) -> Chosen:
    axes, shape = series.axes[:-2], series.shape[:-2]
    along = _slice_axis(series)
    if series.axes[-2:] != "YX" or along is None:
        refuse_other_dimensions(path, (series.keyframe.imagewidth, series.keyframe.imagelength))
        raise BadInput(f"{path}: its axes {series.axes} are no slices of Y and X; export one volume of it")
    channels = image.channels if image is not None else ()
    index: list[int | slice] = [0] * len(shape)
    index[along] = slice(None)
    asked, given = [], []
    chooses = {axis.lower() for n, axis in enumerate(axes) if n != along}
    for key in said.values:
        if key != "series" and key not in chooses:
            raise BadInput(f"{path}: there is nothing to choose by {key}; leave out {key}={said.values[key]}")
    for n, (axis, size) in enumerate(zip(axes, shape, strict=True)):
        key = axis.lower()
        if n == along:
            continue
        if axes.count(axis) > 1:
            refuse_other_dimensions(path, (*reversed(series.shape),))
        if key in said.values:
            index[n] = index_in(path, said.values[key], size, _plural(axis))
        elif size > 1:
            asked.append(_told(axis, size, channels if axis == "C" else ()))
        if size > 1:
            given.append(f"{key}={said.values.get(key, 0)}")
    prefix = [f"series={said.values['series']}"] if "series" in said.values else []
    if asked:
        example = ",".join((*prefix, *given))
        raise BadInput(f"{path}: has {' and '.join(asked)}; choose, as in {path}#{example}")
    channel = index[axes.index("C")] if "C" in axes else 0
    named = axes[along] not in "ZIQ"
    return Chosen(
        pages=np.arange(math.prod(shape)).reshape(shape)[tuple(index)].tolist(),
        name=",".join((*prefix, *given)),
        channel=channels[channel] if isinstance(channel, int) and channel < len(channels) else "",
        warnings=(f"the file has no slices: its {shape[along]} {_plural(axes[along])} are taken as slices",) * named,
    )


def _plural(axis: str) -> str:
    return WHAT_ALONG.get(axis, f"places along {axis}")


def _told(axis: str, size: int, names: Sequence[str]) -> str:
    numbers = ", ".join(f"{axis.lower()}={n} “{name}”" for n, name in enumerate(names)) if any(names) else ""
    return f"{size} {_plural(axis)} ({numbers or f'{axis.lower()}=0 to {size - 1}'})"


def _page(path: Path, series: Any, number: int, image: OmeImage | None) -> TiffPage:
    """A page of the series. Raises BadInput where it is in a file that is missing."""
    packing = series.keyframe
    if series.dataoffset is not None and len(series.pages) <= number:  # one page stands for all, ImageJ's beyond 4 GB
        size = packing.imagelength * packing.imagewidth * packing.dtype.itemsize
        return TiffPage(path, 0, (series.dataoffset + number * size,), (size,), packing)
    page = series.pages[number] if number < len(series.pages) else None
    if page is None:
        files = [name for name in (image.files if image is not None else ()) if not (path.parent / name).is_file()]
        where = f"{' or '.join(files)}, which is not beside this file" if files else "none of its pages"
        raise BadInput(f"{path}: plane {number} should be in {where}; fetch or export the whole set again")
    held = Path(page.parent.filehandle.path)
    return TiffPage(held, page.index, tuple(page.dataoffsets), tuple(page.databytecounts), page.keyframe)


def _format(file: Any, pages: Sequence[TiffPage]) -> str:
    files = len({page.path for page in pages})
    kind = "OME-TIFF" if file.is_ome else "ImageJ TIFF stack" if file.is_imagej else "TIFF stack"
    return f"{kind} of {files} files" if files > 1 else kind


def stack_of(path: Path, shown: str, pages: Sequence[TiffPage], place: Place, chosen: Chosen) -> TiffStackReader:
    """The reader for pages of one size. Raises BadInput where their files hold less than they promise."""
    packing = pages[0].packing
    dims = (packing.imagewidth, packing.imagelength, len(pages))
    refuse_other_dimensions(path, dims if len(pages) > 1 else dims[:2])
    if packing.imagedepth != 1:
        raise BadInput(f"{path}: has pages of several slices each; save one slice a page")
    if packing.dtype is None or WIDER.get(packing.dtype.name, packing.dtype.name) not in SCALAR_TYPES:
        refuse_vectors(path, f"pixels of type {packing.dtype or 'unknown'}, no plain number")
    sizes = {held: held.stat().st_size for held in {page.path for page in pages}}
    for page in pages:
        page.check_within(sizes[page.path], path)
    stored = sum(sum(page.counts) for page in pages)
    if math.prod(dims) * packing.bitspersample // 8 > stored * MOST_GROWTH.get(packing.compression, math.inf):
        raise BadInput(f"{path}: promises more pixels than its {stored} bytes can hold; its tags are wrong")
    matrix, origin = _turned(place.steps, packing, dims)
    raw = _raw(path, dims, pages)
    description = VolumeDescription(
        name=f"{path.name}#{chosen.name}" if chosen.name else path.name,
        format=shown,
        geometry=checked_geometry(path, dims, matrix, origin),
        scalar_type=WIDER.get(packing.dtype.name, packing.dtype.name),
        unit=place.unit,
        density_name=chosen.channel or "density",
        warnings=(*chosen.warnings, *place.warnings),
        chunk=raw.chunk if raw is not None else (*pages[0].segment, 1),
    )
    return TiffStackReader(description, pages, raw)


def _raw(path: Path, dims: Index, pages: Sequence[TiffPage]) -> StoredVoxels | None:
    offsets = [page.raw_offset for page in pages]
    pieces = [Piece(page.path, 1, offset) for page, offset in zip(pages, offsets, strict=True) if offset is not None]
    if len(pieces) < len(pages):
        return None
    packing = pages[0].packing
    return StoredVoxels(path, dims, packing.dtype.newbyteorder(packing.parent.byteorder), tuple(pieces))


def _turned(steps: Vector, packing: Any, dims: Index) -> tuple[Matrix, Vector]:
    """Where i, j, k lead: x to the right, y down, z from slice to slice, whatever corner the pixels begin at."""
    columns = [[0.0] * 3, [0.0] * 3, [0.0, 0.0, steps[2]]]
    origin = [0.0] * 3
    orientation = packing.tags.valueof(274, 1)
    for n, (axis, sign) in enumerate(LED_BY_ORIENTATION.get(orientation, LED_BY_ORIENTATION[1])):
        columns[n][axis] = sign * steps[axis]
        if sign < 0:
            origin[axis] = (dims[n] - 1) * steps[axis]
    rows = [(columns[0][row], columns[1][row], columns[2][row]) for row in range(3)]
    return (rows[0], rows[1], rows[2]), (origin[0], origin[1], origin[2])


def stated_place(file: Any, packing: Any, image: OmeImage | None, kept_in: str) -> Place:
    if image is not None:
        return _place(image.steps, image.unit)
    if file.is_imagej:
        said = file.imagej_metadata or {}
        unit = str(said.get("unit", "")).encode("latin-1", "ignore").decode("unicode_escape")
        x, y = _resolutions(packing)
        between = said.get("spacing")
        z = abs(float(between)) if between else None
        known = length_unit(unit)
        return _place((1 / x if x else None, 1 / y if y else None, z), known.symbol if known else "")
    place = _plain_place(packing)
    if kept_in:
        told = f"the metadata of this OME-TIFF is in {kept_in}, which volsplat does not read: steps are not known"
        return Place(place.steps, place.unit, (*place.warnings, told))
    return place


def _plain_place(packing: Any) -> Place:
    """The pixels' size by the tags of resolution, unless they are those of a screen or a printer."""
    per = MILLIMETRES_PER.get(packing.tags.valueof(296, 2))
    x, y = _resolutions(packing)
    if per is None or not x or not y or round(x * 25.4 / per, 2) in SCREENS_AND_PRINTERS:
        ratio = x / y if x and y else 1.0
        return Place((1.0, ratio, 1.0), "", ())
    return _place((per / x, per / y, None), "mm")


def _resolutions(packing: Any) -> tuple[float, float]:
    """Pixels per unit along x and y, 0 where the page states none."""
    values = (packing.tags.valueof(282, (0, 1)), packing.tags.valueof(283, (0, 1)))
    x, y = (top / bottom if bottom else 0.0 for top, bottom in values)
    return x, y


def _place(stated: StatedSteps, unit: str) -> Place:
    """The steps as stated, the others as wide as a pixel, which is told."""
    x, y, z = stated
    if x is None:
        told = () if (y, z) == (None, None) else ("the file states no width of its pixels: taken as 1",)
        return Place((1.0, 1.0 if y is None else y, 1.0 if z is None else z), "", told)
    missing = [name for name, step in (("height of its pixels", y), ("distance of its slices", z)) if step is None]
    told = (f"the file states no {' and no '.join(missing)}: taken as the width of a pixel",) if missing else ()
    return Place((x, x if y is None else y, x if z is None else z), unit, told)
