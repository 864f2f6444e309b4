"""The stored values of single DICOM frames, before any rescale: as they lie in the file, or packed.

Of frames that are not packed, only the wanted rows are read. Packed ones (RLE, JPEG, JPEG-LS, JPEG 2000) are cut out
of their file one by one and decoded by SimpleITK's GDCM, so that one frame of a large file needs no other.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import BinaryIO

import numpy as np

from volsplat.mapshade_server.readers.reading.codestream_size import check_codestream
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.simple_itk import extracted, header_of
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

ITEM, END_OF_ITEMS = b"\xfe\xff\x00\xe0", b"\xfe\xff\xdd\xe0"
_TERMINAL = Lock()
SECONDARY_CAPTURE = "1.2.840.10008.5.1.4.1.1.7"  # says nothing that would change the values


@dataclass(frozen=True)
class Pixels:
    """How a file's frames are stored. `fragments` are the packed pieces, (offset, length), () if not packed."""

    path: Path
    columns: int
    rows: int
    frames: int
    dtype: np.dtype[np.generic]  # of the stored values, with the file's byte order
    bits_stored: int
    high_bit: int
    offset: int
    transfer_syntax: str
    syntax_name: str
    fragments: tuple[tuple[int, int], ...] = ()

    @property
    def frame_bytes(self) -> int:
        return self.columns * self.rows * self.dtype.itemsize

    def check_file(self) -> None:
        """Raises BadInput if the file ends before its frames do."""
        if not self.fragments:
            self._in_place(0, self.frames).check_files()

    def read(self, frame: int, box: Box) -> Voxels:
        """The stored values of the box's rectangle, (j, i), in native byte order and without unused bits."""
        if self.fragments:
            stored = self._unpacked(frame)[box.low[1] : box.high[1], box.low[0] : box.high[0]]
        else:
            stored = self._in_place(frame, 1).read(Box((*box.low[:2], 0), (*box.high[:2], 1)))[0]
        return self._without_unused_bits(stored)

    def _in_place(self, frame: int, count: int) -> StoredVoxels:
        piece = Piece(self.path, count, self.offset + frame * self.frame_bytes)
        return StoredVoxels(self.path, (self.columns, self.rows, count), self.dtype, (piece,))

    def _without_unused_bits(self, stored: Voxels) -> Voxels:
        """Bits above those that count hold overlays or nothing; the sign is the highest that counts."""
        bits = 8 * self.dtype.itemsize
        if self.dtype.kind == "f" or self.bits_stored == bits:
            return stored
        above = bits - 1 - self.high_bit
        return (stored << above) >> (bits - self.bits_stored)

    def _unpacked(self, frame: int) -> Voxels:
        pydicom = library("pydicom", "DICOM")
        head = pydicom.Dataset()
        head.SOPClassUID, head.SOPInstanceUID = SECONDARY_CAPTURE, "1.2"
        head.Rows, head.Columns, head.SamplesPerPixel = self.rows, self.columns, 1
        head.PhotometricInterpretation = "MONOCHROME2"
        head.BitsAllocated, head.BitsStored, head.HighBit = 8 * self.dtype.itemsize, self.bits_stored, self.high_bit
        head.PixelRepresentation = int(self.dtype.kind == "i")
        packed = self._packed(frame)
        try:
            check_codestream(packed, self.columns, self.rows)
        except ValueError as error:
            raise BadInput(f"{self.path}: frame {frame} is damaged: {error}; export it again") from None
        head.PixelData = pydicom.encaps.encapsulate([packed])
        head.file_meta = pydicom.dataset.FileMetaDataset()
        head.file_meta.TransferSyntaxUID = self.transfer_syntax
        with TemporaryDirectory(prefix="volsplat-") as folder:
            path = Path(folder) / "frame.dcm"
            pydicom.dcmwrite(path, head, enforce_file_format=True)
            try:
                with _quiet_terminal():
                    reader = header_of(path, "GDCMImageIO")
                    values = extracted(path, reader, Box((0, 0, 0), (self.columns, self.rows, 1)))
            except BadInput:
                raise BadInput(
                    f"{self.path}: frame {frame} cannot be decoded: it is damaged, or GDCM does not know this kind of "
                    f"{self.syntax_name}; save the series uncompressed"
                ) from None
        return values.reshape(self.rows, self.columns).astype(self.dtype.newbyteorder("="), copy=False)

    def _packed(self, frame: int) -> bytes:
        """The frame's packed bytes: one fragment of as many, or as the file's own table of frames has it."""
        with opened(self.path) as file:
            if len(self.fragments) == self.frames:
                offset, length = self.fragments[frame]
                file.seek(offset)
                return file.read(length)
            file.seek(self.offset)
            try:
                packed: bytes = library("pydicom.encaps", "DICOM").get_frame(file, frame, number_of_frames=self.frames)
            except (ValueError, EOFError) as error:
                raise BadInput(f"{self.path}: frame {frame} is not in the file ({error}); export it again") from None
            return packed


@contextmanager
def _quiet_terminal() -> Iterator[None]:
    """Keeps what GDCM's decoders say off the terminal, to which they write past all exceptions."""
    with _TERMINAL, Path(os.devnull).open("wb") as nowhere:
        saved = os.dup(2)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)


def fragments_from(path: Path, file: BinaryIO) -> Iterator[tuple[int, int]]:
    """The packed pieces of the frames, after the table of frames. Raises BadInput if the file ends before them."""
    end = path.stat().st_size
    first = True
    while (head := file.read(8))[:4] == ITEM:
        length = int.from_bytes(head[4:], "little")
        if file.tell() + length > end:
            break
        if not first:
            yield file.tell(), length
        first = False
        file.seek(length, 1)
    if head[:4] != END_OF_ITEMS:
        raise BadInput(f"{path}: is truncated within its packed frames; fetch it again or remove it")
