"""The values of single TIFF pages. Only the strips or tiles that touch the wanted rectangle are read and decoded.

What tifffile cannot decode without further libraries (LZW, JPEG, ...) goes through OpenImageIO, page by page.
"""

import importlib
import importlib.util
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO

import numpy as np

from volsplat.mapshade_server.readers.extra import library
from volsplat.mapshade_server.readers.volume_reader import Voxels
from volsplat.protocol.errors import BadInput
from volsplat.protocol.volume import Box

UNCOMPRESSED, DEFLATE, OLD_DEFLATE, LZMA = 1, 8, 32946, 34925
DECODED_BY_TIFFFILE = (UNCOMPRESSED, DEFLATE, OLD_DEFLATE, LZMA)
WHOLE_BYTES = (8, 16, 32, 64)

# How many bytes one stored byte can become at most, of the ways of packing for which that is known.
MOST_GROWTH = {UNCOMPRESSED: 1, DEFLATE: 1032, OLD_DEFLATE: 1032}


@cache
def tifffile() -> ModuleType:
    """The module, silent: what it logs of damaged files is found here by looking at what it made of them."""
    module = library("tifffile", "TIFF")
    logging.getLogger("tifffile").addHandler(logging.NullHandler())
    return module


@dataclass(frozen=True)
class TiffPage:
    """One page: where its strips or tiles lie in the file, and tifffile's page that tells how they are packed."""

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

    def check_within(self, size: int, source: Path) -> None:
        """Raises BadInput where a strip or tile lies beyond the end of its file, of `size` bytes."""
        if any(start + count > size for start, count in zip(self.offsets, self.counts, strict=True)):
            raise BadInput(f"{source}: is truncated: its pixels lie beyond its end; fetch or export it again")

    def read(self, file: BinaryIO, box: Box) -> Voxels:
        """The values of the box's rectangle. Raises BadInput where they are damaged or packed in an unknown way."""
        if not _decoded_by_tifffile(self.packing):
            return self._by_openimageio(box)
        (i0, j0, _), (i1, j1, _) = box
        values = np.full((j1 - j0, i1 - i0), self.packing.nodata, self.packing.dtype)
        try:
            for number in self._touched(box):
                file.seek(self.offsets[number])
                packed = file.read(self.counts[number]) if self.counts[number] else None
                segment, (_, _, top, left, _), shape = self.packing.decode(
                    packed, number, jpegtables=self.packing.jpegtables
                )
                if segment is None:
                    continue
                low_j, high_j = max(top, j0), min(top + shape[1], j1)
                low_i, high_i = max(left, i0), min(left + shape[2], i1)
                values[low_j - j0 : high_j - j0, low_i - i0 : high_i - i0] = segment[
                    0, low_j - top : high_j - top, low_i - left : high_i - left, 0
                ]
        except Exception as error:  # each of the decoders has exceptions of its own
            raise BadInput(f"{self.path}: page {self.number} is damaged ({error}); export it again") from None
        return values

    def _touched(self, box: Box) -> Iterator[int]:
        """The numbers of the strips or tiles that share values with the box's rectangle."""
        packing = self.packing
        tiled = packing.is_tiled
        length = packing.tilelength if tiled else min(packing.rowsperstrip, packing.imagelength)
        width = packing.tilewidth if tiled else packing.imagewidth
        per_row = -(-packing.imagewidth // width)
        for row in range(box.low[1] // length, -(-box.high[1] // length)):
            for column in range(box.low[0] // width, -(-box.high[0] // width)):
                yield row * per_row + column

    def _by_openimageio(self, box: Box) -> Voxels:
        oiio = importlib.import_module("OpenImageIO")
        image = oiio.ImageInput.open(str(self.path))
        try:
            # OpenImageIO spreads other numbers of bits over the range of the next type.
            if image and self.packing.bitspersample in WHOLE_BYTES and image.seek_subimage(self.number, 0):
                values = image.read_image(self.number, 0, 0, 1, oiio.UNKNOWN)
                if values is not None and values.shape[:2] == (self.packing.imagelength, self.packing.imagewidth):
                    whole: Voxels = values.reshape(values.shape[:2])
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
