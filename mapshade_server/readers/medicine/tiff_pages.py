"""The values of single TIFF pages. Only the strips or tiles that touch the wanted rectangle are read and decoded.

What tifffile cannot decode without further libraries (LZW, JPEG, ...) goes through OpenImageIO, page by page.
"""

import importlib
import importlib.util
import logging
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO

import numpy as np

from volsplat.mapshade_server.readers.reading.bounded_unpacking import (
    Damaged,
    check_promise,
    inflated,
    unpacked_by_imagecodecs,
    unpacked_lzma,
)
from volsplat.mapshade_server.readers.reading.codestream_size import check_codestream, codestream_size
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.grids import refuse_vectors
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

UNCOMPRESSED, DEFLATE, OLD_DEFLATE, LZMA = 1, 8, 32946, 34925
DECODED_BY_TIFFFILE = (UNCOMPRESSED, DEFLATE, OLD_DEFLATE, LZMA)
FROM_WHITE, PALETTE = 0, 3  # of the tag PhotometricInterpretation
WHOLE_BYTES = (8, 16, 32, 64)
SIZED = (6, 7, 33003, 33004, 33005, 33007, 34712)  # JPEG and JPEG 2000, whose codestreams state their size
LZW, PACKBITS, ZSTD, OLD_ZSTD = 5, 32773, 50000, 34926
BOUNDED: dict[int, Callable[[bytes, int], bytes]] = {
    DEFLATE: inflated,
    OLD_DEFLATE: inflated,
    LZMA: unpacked_lzma,
    LZW: partial(unpacked_by_imagecodecs, "lzw"),
    PACKBITS: partial(unpacked_by_imagecodecs, "packbits"),
    ZSTD: partial(unpacked_by_imagecodecs, "zstd"),
    OLD_ZSTD: partial(unpacked_by_imagecodecs, "zstd"),
}
TURNED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
SLACK = 1 << 12  # bytes that some programs write after a strip's last row

# How many bytes one stored byte can become at most, of the ways of packing for which that is known.
MOST_GROWTH = {UNCOMPRESSED: 1, DEFLATE: 1032, OLD_DEFLATE: 1032}


@cache
def tifffile() -> ModuleType:
    """The module, silent: what it logs of damaged files is found here by looking at what it made of them."""
    module = library("tifffile", "TIFF")
    logging.getLogger("tifffile").addHandler(logging.NullHandler())
    return module


def check_kind(path: Path, packing: Any) -> None:
    """Raises BadInput for pages, packed as tifffile's page says, that are no slices of single values."""
    if packing.samplesperpixel != 1:
        refuse_vectors(path, f"{packing.samplesperpixel} samples a pixel")
    if packing.imagedepth != 1:
        raise BadInput(f"{path}: has pages of several slices each; save one slice a page")


@dataclass(frozen=True)
class TiffPage:
    """One page: where its strips or tiles lie in the file, and tifffile's page that says how they are packed."""

    path: Path
    number: int  # in the file
    offsets: tuple[int, ...]
    counts: tuple[int, ...]
    packing: Any

    @property
    def raw_offset(self) -> int | None:
        """Where the values begin, if they lie in the file as they are, row after row."""
        size = self.packing.imagelength * self.packing.imagewidth * self.packing.dtype.itemsize
        packed = self.packing.compression != UNCOMPRESSED or self.packing.predictor != 1 or self.packing.fillorder != 1
        if packed or self.packing.is_tiled or self.packing.bitspersample != 8 * self.packing.dtype.itemsize:
            return None
        ends = [start + count for start, count in zip(self.offsets, self.counts, strict=True)]
        return self.offsets[0] if list(self.offsets[1:]) == ends[:-1] and sum(self.counts) >= size else None

    @property
    def from_white(self) -> bool:
        """Whether the greatest value means black."""
        return bool(self.packing.photometric == FROM_WHITE)

    @property
    def has_palette(self) -> bool:
        """Whether values are the numbers of colours."""
        return bool(self.packing.photometric == PALETTE)

    def check_within(self, size: int, source: Path) -> None:
        """Raises BadInput if a strip or tile lies beyond the end of its file, of `size` bytes."""
        if any(start + count > size for start, count in zip(self.offsets, self.counts, strict=True)):
            raise BadInput(f"{source}: is truncated: its pixels lie beyond its end; fetch or export it again")
        packing = self.packing
        (columns, rows), bits = self.segment, packing.bitspersample * packing.samplesperpixel
        check_promise(source, columns * rows * bits // 8, packing.imagewidth * packing.imagelength * bits // 8)

    def read(self, file: BinaryIO, box: Box) -> Voxels:
        """The values of the box's rectangle. Raises BadInput if they are damaged or packed in an unknown way."""
        if not _decoded_by_tifffile(self.packing):
            return self._by_openimageio(box)
        (i0, j0, _), (i1, j1, _) = box
        values = np.full((j1 - j0, i1 - i0), self.packing.nodata, self.packing.dtype)
        try:
            for number in self._touched(box):
                file.seek(self.offsets[number])
                packed = file.read(self.counts[number]) if self.counts[number] else None
                decode, stored = self._unpacked(packed)
                segment, (_, _, top, left, _), shape = decode(stored, number, jpegtables=self.packing.jpegtables)
                if segment is None:
                    continue
                low_j, high_j = max(top, j0), min(top + shape[1], j1)
                low_i, high_i = max(left, i0), min(left + shape[2], i1)
                values[low_j - j0 : high_j - j0, low_i - i0 : high_i - i0] = segment[
                    0, low_j - top : high_j - top, low_i - left : high_i - left, 0
                ]
        except BadInput:
            raise
        except Exception as error:  # each of the decoders has exceptions of its own
            raise BadInput(f"{self.path}: page {self.number} is damaged ({error}); export it again") from None
        return values

    @property
    def segment(self) -> tuple[int, int]:
        """Columns and rows of a strip or tile."""
        packing = self.packing
        if packing.is_tiled:
            return packing.tilewidth, packing.tilelength
        return packing.imagewidth, min(packing.rowsperstrip, packing.imagelength)

    def _unpacked(self, packed: bytes | None) -> tuple[Callable[..., Any], bytes | None]:
        """How to decode a strip or tile, and what: unpacked here if tifffile would unpack without an end."""
        unpack = BOUNDED.get(self.packing.compression)
        width, length = self.segment
        if packed is None:
            return self.packing.decode, None
        if unpack is None:
            if self.packing.compression != UNCOMPRESSED:
                self._check_codestream(packed)
            return self.packing.decode, packed
        if self.packing.fillorder != 1:
            packed = packed.translate(TURNED)
        most = -(-width * self.packing.bitspersample // 8) * length * self.packing.samplesperpixel
        return self._without_packing.decode, unpack(packed, most + SLACK)

    def _check_codestream(self, packed: bytes) -> None:
        """Raises ValueError if a codec could make more of it than the page promises, BadInput if nobody can tell."""
        if codestream_size(packed) is None and self.packing.compression not in SIZED:
            name = getattr(self.packing.compression, "name", self.packing.compression)
            raise BadInput(
                f"{self.path}: page {self.number} is packed by {name}, which is not read, since it states no size that "
                "could be checked; save it packed by zstd or deflate"
            )
        if codestream_size(packed) is None:
            raise Damaged("its codestream states no size")
        check_codestream(packed, *self.segment)

    @cached_property
    def _without_packing(self) -> Any:
        """The page as if its strips or tiles were not compressed."""
        page = copy(self.packing)
        page.__dict__.pop("decode", None)  # which is made for the compression
        page.compression, page.fillorder = UNCOMPRESSED, 1
        return page

    def _touched(self, box: Box) -> Iterator[int]:
        """The numbers of the strips or tiles that share values with the box's rectangle."""
        packing = self.packing
        width, length = self.segment
        per_row = -(-packing.imagewidth // width)
        for row in range(box.low[1] // length, -(-box.high[1] // length)):
            for column in range(box.low[0] // width, -(-box.high[0] // width)):
                yield row * per_row + column

    def _by_openimageio(self, box: Box) -> Voxels:
        oiio = importlib.import_module("OpenImageIO")
        image = oiio.ImageInput.open(str(self.path))
        try:
            # OpenImageIO spreads other numbers of bits over the range of the next type, and makes colours of a palette.
            as_stored = self.packing.bitspersample in WHOLE_BYTES and not self.has_palette
            if image and as_stored and image.seek_subimage(self.number, 0):
                values = image.read_image(self.number, 0, 0, 1, oiio.UNKNOWN)
                if values is not None and values.shape[:2] == (self.packing.imagelength, self.packing.imagewidth):
                    whole: Voxels = values.reshape(values.shape[:2])
                    if self.from_white and whole.dtype == np.uint8:  # of these alone OpenImageIO makes the negative
                        whole = ~whole
                    return whole[box.low[1] : box.high[1], box.low[0] : box.high[0]].astype(self.packing.dtype)
            told = (image.geterror() if image else oiio.geterror()).strip().replace("\n", " ")
        finally:
            if image:
                image.close()
        name = getattr(self.packing.compression, "name", str(self.packing.compression))
        raise BadInput(
            f"{self.path}: page {self.number} cannot be decoded, {self.packing.bitspersample} bits packed as {name}"
            f"{told and f' ({told})'}; save it uncompressed, or: pip install imagecodecs"
        )


def _decoded_by_tifffile(packing: Any) -> bool:
    """Whether tifffile should decode: what it does itself and fast, or everything with the library imagecodecs."""
    itself = packing.compression in DECODED_BY_TIFFFILE and packing.predictor in (1, 2)
    return itself or importlib.util.find_spec("imagecodecs") is not None
