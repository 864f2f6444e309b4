"""TIFF stacks, one page for each slice, through SimpleITK, which reads them whole.

The directory of pages is walked here first: of a truncated file SimpleITK would silently return fewer slices.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

from volsplat.mapshade_server.readers.simple_itk import (
    check_is_volume,
    extracted,
    geometry_of,
    header_of,
    refuse_other_dimensions,
    refuse_vectors,
    scalar_type_of,
)
from volsplat.mapshade_server.readers.volume_reader import Voxels
from volsplat.protocol.errors import BadInput
from volsplat.protocol.volume import Box, VolumeDescription

MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
MOST_PAGES = 1 << 16
MOST_VALUES = 1 << 20  # of one tag

WIDTH, HEIGHT, BITS, SAMPLES, FORMAT = 256, 257, 258, 277, 339
OFFSETS = (273, 324)  # of strips, of tiles
COUNTS = (279, 325)
VALUE_BYTES = {1: 1, 3: 2, 4: 4, 16: 8}  # the whole-number types


def recognises(head: bytes) -> bool:
    return head[:4] in MAGICS


class TiffStackReader:
    """One TIFF stack; the voxels are read once, whole, and kept."""

    def __init__(self, path: Path, description: VolumeDescription, reader: Any) -> None:
        self._path = path
        self._description = description
        self._reader = reader
        self._whole: Voxels | None = None

    def describe(self) -> VolumeDescription:
        return self._description

    def read(self, box: Box) -> Voxels:
        if self._whole is None:
            self._whole = extracted(self._path, self._reader, self._description.geometry.box)
        (i0, j0, k0), (i1, j1, k1) = box
        return self._whole[k0:k1, j0:j1, i0:i1].copy()


def open_tiff_stack(path: Path) -> TiffStackReader:
    """The reader for a TIFF stack. Raises BadInput for truncated files, colour, and pages of several sizes."""
    with path.open("rb") as file:
        pages = list(_pages(path, file))
    width, height = _one(pages[0], WIDTH, 0), _one(pages[0], HEIGHT, 0)
    refuse_other_dimensions(path, (width, height, len(pages)) if len(pages) > 1 else (width, height))
    for n, page in enumerate(pages):
        if _one(page, SAMPLES, 1) != 1:
            refuse_vectors(path, f"{_one(page, SAMPLES, 1)} samples a pixel")
        if any(_one(page, tag, 1) != _one(pages[0], tag, 1) for tag in (WIDTH, HEIGHT, BITS, FORMAT)):
            raise BadInput(f"{path}: page {n + 1} differs from the first in size or type; save one stack alone")
    reader = header_of(path, "TIFFImageIO")
    check_is_volume(path, reader)
    description = VolumeDescription(
        name=path.name,
        format="TIFF stack",
        geometry=geometry_of(path, reader),
        scalar_type=scalar_type_of(path, reader),
        reads_sub_cubes=False,
        why_whole="TIFF stacks are decoded whole",
    )
    return TiffStackReader(path, description, reader)


Page = dict[int, list[int]]  # the values of the tags that matter here


def _one(page: Page, tag: int, default: int) -> int:
    return page.get(tag, [default])[0]


@dataclass(frozen=True)
class _Layout:
    """The numbers of a TIFF file: its byte order, and whether offsets have 4 or (BigTIFF) 8 bytes."""

    order: Literal["little", "big"]
    big: bool

    @property
    def offset_bytes(self) -> int:
        return 8 if self.big else 4

    @property
    def entry_bytes(self) -> int:
        return 20 if self.big else 12

    def number(self, raw: bytes) -> int:
        return int.from_bytes(raw, self.order)


def _pages(path: Path, file: BinaryIO) -> Iterator[Page]:
    """The pages in order. Raises BadInput where a page or its pixels lie beyond the end of the file."""
    end = path.stat().st_size
    truncated = BadInput(f"{path}: is truncated: its pages or pixels lie beyond its end; fetch or export it again")
    magic = file.read(4)
    layout = _Layout("little" if magic[:1] == b"I" else "big", b"+" in magic)
    file.seek(8 if layout.big else 4)
    offset = layout.number(file.read(layout.offset_bytes))
    seen: set[int] = set()
    while offset:
        if offset in seen or len(seen) >= MOST_PAGES:
            raise BadInput(f"{path}: its directory of pages does not end; export it again")
        seen.add(offset)
        file.seek(offset)
        count = layout.number(file.read(8 if layout.big else 2))
        entries = file.read(count * layout.entry_bytes) if count < MOST_VALUES else b""
        following = file.read(layout.offset_bytes)
        if count == 0 or len(following) < layout.offset_bytes:
            raise truncated
        page = {
            tag: values
            for start in range(0, len(entries), layout.entry_bytes)
            for tag, values in _entry(file, layout, entries[start : start + layout.entry_bytes])
        }
        for offsets, counts in zip(OFFSETS, COUNTS, strict=True):
            blocks = zip(page.get(offsets, []), page.get(counts, []), strict=False)
            if any(start + size > end for start, size in blocks):
                raise truncated
        yield page
        offset = layout.number(following)
    if not seen:
        raise truncated


def _entry(file: BinaryIO, layout: _Layout, entry: bytes) -> Iterator[tuple[int, list[int]]]:
    """The tag and its values, if it is one of those that matter."""
    tag, kind = layout.number(entry[:2]), layout.number(entry[2:4])
    size = VALUE_BYTES.get(kind)
    if size is None or tag not in (WIDTH, HEIGHT, BITS, SAMPLES, FORMAT, *OFFSETS, *COUNTS):
        return
    count = layout.number(entry[4 : 4 + layout.offset_bytes])
    raw = entry[4 + layout.offset_bytes :]
    if count > MOST_VALUES:
        return
    if count * size > len(raw):
        file.seek(layout.number(raw))
        raw = file.read(count * size)
    yield tag, [layout.number(raw[n * size : (n + 1) * size]) for n in range(min(count, len(raw) // size))]
