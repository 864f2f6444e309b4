"""TIFF stacks, one page for each slice: plain ones, ImageJ's and OME-TIFF, also BigTIFF, through tifffile.

If a file holds several images, channels or times, the person chooses: `cells.ome.tif#series=1,c=0,t=3`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.medicine.ome_tiff import OmeImage, OmeMetadata, ome_metadata
from volsplat.mapshade_server.readers.medicine.tiff_pages import MOST_GROWTH, TiffPage, check_kind, tifffile
from volsplat.mapshade_server.readers.medicine.tiff_place import Place, placed, stated_place
from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.mapshade_server.readers.reading.grids import (
    PALETTE_LEFT_OUT,
    refuse_other_dimensions,
    refuse_vectors,
)
from volsplat.mapshade_server.readers.reading.named_files import named_file
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.part_options import PartOptions, index_in, part_options
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_files import disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import (
    SCALAR_TYPES,
    OpenedVolume,
    VolumeFormat,
    Voxels,
    voxel_room,
)
from volsplat.protocol.description.volume import Box, Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
WIDER = {"bool": "uint8", "float16": "float32"}  # types that tensors of voxels do not have
COUNTED_FROM_WHITE = "its photometric counts from white: values are as they are stored, and the greatest means black"
MOST_COLOURS = 4  # more channels that nobody states, where there are no slices, are no colours
IMAGEJ_COLOURS = ("color", "composite")  # how ImageJ shows what it knows as channels
WHAT_ALONG = {"C": "channels", "T": "times", "Z": "slices"}


def open_tiff_stack(path: Path, part: str) -> OpenedVolume:
    """The reader for a TIFF file and the image, channel and time of it that are named.

    Raises BadInput for truncated files, colour, pages of several sizes, and if something must be chosen.
    """
    with opened_tiff(path) as file:
        return _stack(path, part, file)


@contextmanager
def opened_tiff(path: Path) -> Iterator[Any]:
    """tifffile's view of a file that is whole. Raises BadInput, also for what is raised within."""
    try:
        with tifffile().TiffFile(path) as file:
            _check_ends(path, file)
            _check_set(path, file)
            yield file
    except (BadInput, OSError):
        raise
    except Exception as error:  # of a damaged file's tags tifffile makes anything
        raise BadInput(f"{path}: is truncated or damaged ({error}); fetch or export it again") from None


def _stack(path: Path, part: str, file: Any) -> OpenedVolume:
    ome = ome_metadata(file.ome_metadata) if file.is_ome else OmeMetadata((), "")
    every = file.series
    if every[0].kind in ("uniform", "generic") and len(every) > 1:
        page = min(series.keyframe.index for series in every[1:]) + 1
        raise BadInput(f"{path}: page {page} differs from the first in size or type; save one stack alone")
    said = part_options(part, ("series", *(axis.lower() for series in every for axis in series.axes)))
    number = _series_number(path, said, every)
    series = every[number]
    packing = series.keyframe
    check_kind(path, packing)
    image = ome.of(number, series.name, (packing.imagewidth, packing.imagelength))
    along = _stacked_axis(path, series, _states_channels(series, file.imagej_metadata or {}))
    chosen = _chosen(path, said, series, image, along)
    pages = [_page(path, series, n, image) for n in chosen.pages]
    place = stated_place(file, packing, image, ome.kept_in)
    return stack_of(path, _format(file, pages), pages, place, chosen)


def _check_ends(path: Path, file: Any) -> None:
    """Raises BadInput if the chain of pages breaks off; tifffile takes the pages before as all there are."""
    count = len(file.pages)
    next_page = file.pages.next_page_offset
    if count and next_page is not None:
        file.filehandle.seek(next_page)
        if not any(file.filehandle.read(file.tiff.offsetsize)):
            return
    raise BadInput(f"{path}: is truncated: its pages lie beyond its end; fetch or export it again")


def _check_set(path: Path, file: Any) -> None:
    """Raises BadInput if a file that belongs to the same set is a FIFO, which tifffile would wait for."""
    told = ome_metadata(file.ome_metadata) if file.is_ome else OmeMetadata((), "")
    named = [named_file(path, name) for image in told.images for name in (*image.files, told.kept_in) if name]
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
    line = f"{path}: holds {len(volumes)} images: {shown}; choose one, as in {path}#series={volumes[0]}"
    raise PartNeeded(line, [Part(f"series={n}", f"image {n}, {every[n].name}") for n in volumes])


def _slice_axis(series: Any) -> int | None:
    """Which of the series' axes is that of the slices: Z, or the only one left, as of files that name none."""
    long = [n for n, size in enumerate(series.shape[:-2]) if size > 1]
    named = [n for n in long if series.axes[n] == "Z"]
    other = [n for n in long if series.axes[n] not in "CS"]
    return next(iter([*named, *reversed(other)]), None)


def _states_channels(series: Any, imagej: Mapping[str, Any]) -> bool:
    """Whether somebody says that channels are such: programs that name no axes call all pages of ImageJ's channels."""
    return series.kind != "imagej" or imagej.get("mode") in IMAGEJ_COLOURS or "Labels" in imagej


def _stacked_axis(path: Path, series: Any, states_channels: bool) -> int:
    """The axis that is drawn as slices. Raises BadInput if none can be."""
    if (along := _slice_axis(series)) is not None and series.axes[-2:] == "YX":
        return along
    long = [n for n, size in enumerate(series.shape[:-2]) if size > 1]
    width, height = series.keyframe.imagewidth, series.keyframe.imagelength
    if series.axes[-2:] != "YX" or [series.axes[n] for n in long] != ["C"]:
        refuse_other_dimensions(path, (width, height))
    if series.shape[long[0]] > MOST_COLOURS and not states_channels:
        return long[0]
    raise BadInput(
        f"{path}: a 2-D image of {series.shape[long[0]]} channels of {width} x {height}, no slices; volsplat needs a "
        "volume: give a file with several slices"
    )


@dataclass(frozen=True)
class Chosen:
    """Which pages of a series make the volume, what they are called, and warnings about the choice."""

    pages: Sequence[int]
    name: str = ""
    channel: str = ""
    warnings: tuple[str, ...] = ()


def _chosen(path: Path, said: PartOptions, series: Any, image: OmeImage | None, along: int) -> Chosen:
    axes, shape = series.axes[:-2], series.shape[:-2]
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
    """A page of the series. Raises BadInput if it is in a file that is missing."""
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


def _told_of_values(page: TiffPage) -> Iterator[str]:
    if page.from_white:
        yield COUNTED_FROM_WHITE
    if page.has_palette:
        yield PALETTE_LEFT_OUT


def stack_of(path: Path, shown: str, pages: Sequence[TiffPage], place: Place, chosen: Chosen) -> OpenedVolume:
    """The reader for pages of one size. Raises BadInput if their files hold less than they promise."""
    packing = pages[0].packing
    dims = (packing.imagewidth, packing.imagelength, len(pages))
    refuse_other_dimensions(path, dims if len(pages) > 1 else dims[:2])
    if packing.dtype is None or WIDER.get(packing.dtype.name, packing.dtype.name) not in SCALAR_TYPES:
        refuse_vectors(path, f"pixels of type {packing.dtype or 'unknown'}, no plain number")
    sizes = {held: held.stat().st_size for held in {page.path for page in pages}}
    for page in pages:
        page.check_within(sizes[page.path], path)
    stored = sum(sum(page.counts) for page in pages)
    if math.prod(dims) * packing.bitspersample // 8 > stored * MOST_GROWTH.get(packing.compression, math.inf):
        raise BadInput(f"{path}: promises more pixels than its {stored} bytes can hold; its tags are wrong")
    raw = _raw(path, dims, pages)
    scalar_type = WIDER.get(packing.dtype.name, packing.dtype.name)
    description = VolumeDescription(
        name=f"{path.name}#{chosen.name}" if chosen.name else path.name,
        format=shown,
        geometry=placed(path, place, packing, dims),
        scalar_type=scalar_type,
        unit=place.unit,
        density_name=chosen.channel or "",
        warnings=(*chosen.warnings, *place.warnings, *_told_of_values(pages[0])),
        chunk=raw.chunk if raw is not None else (*pages[0].segment, 1),
    )

    def read(box: Box) -> Voxels:
        if raw is not None:  # then only rows are read
            return raw.read(box).astype(scalar_type, copy=False)
        return _decoded(pages, box, scalar_type)

    return OpenedVolume(description, read, lambda: disk_files([page.path for page in pages]), parts=())


def _decoded(pages: Sequence[TiffPage], box: Box, scalar_type: str) -> Voxels:
    voxels = voxel_room(box, scalar_type, pages[0].path)
    file = None
    with ExitStack() as files:
        for n, page in enumerate(pages[box.low[2] : box.high[2]]):
            if file is None or file.name != str(page.path):
                files.close()
                file = files.enter_context(opened(page.path))
            voxels[n] = page.read(file, box)
    return voxels


def _raw(path: Path, dims: Index, pages: Sequence[TiffPage]) -> StoredVoxels | None:
    offsets = [page.raw_offset for page in pages]
    pieces = [Piece(page.path, 1, offset) for page, offset in zip(pages, offsets, strict=True) if offset is not None]
    if len(pieces) < len(pages):
        return None
    packing = pages[0].packing
    return StoredVoxels(path, dims, packing.dtype.newbyteorder(packing.parent.byteorder), tuple(pieces))


FORMATS = (VolumeFormat("TIFF stack (.tif, .ome.tif)", open_tiff_stack, lambda head: head[:4] in MAGICS),)
