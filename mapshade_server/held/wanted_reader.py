"""Reads voxels for as long as somebody wants them: large boxes part by part, so that a slow disk holds up nobody."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from volsplat.mapshade_server.readers.reading.volume_reader import ReadBox, VolumeReader, Voxels
from volsplat.protocol.description.volume import SCALAR_BYTES, Box, VolumeDescription

PART_BYTES = 256 << 20  # some seconds of a slow disk; most sub-cubes have less, and are read at once


class GivenUp(Exception):
    """Nobody wants these voxels, or their packets, any more."""


class WantedReader:
    """Reads like the reader that it is made of. Raises GivenUp as soon as it is `given_up`."""

    def __init__(self, reader: VolumeReader, given_up: Callable[[], bool], part_bytes: int = PART_BYTES) -> None:
        self._reader = reader
        self._given_up = given_up
        self._part_bytes = part_bytes

    @property
    def description(self) -> VolumeDescription:
        return self._reader.description

    def read(self, box: Box) -> Voxels:
        return self._by_parts(self._reader.read, box)

    @property
    def read_second(self) -> ReadBox | None:
        read = self._reader.read_second
        return None if read is None else partial(self._by_parts, read)

    def _by_parts(self, read: ReadBox, box: Box) -> Voxels:
        whole: Voxels | None = None
        for part in self._parts(box):
            if self._given_up():
                raise GivenUp
            values = read(part)
            if part == box:
                return values
            if whole is None:
                whole = np.empty(box.size[::-1], values.dtype)
            whole[part.slices(box.low)] = values
        assert whole is not None, "a box without voxels was read"
        return whole

    def _parts(self, box: Box) -> Iterator[Box]:
        """Whole sheets, as many as only come together, or several times as many."""
        described = self._reader.description
        sheet_bytes = box.size[0] * box.size[1] * SCALAR_BYTES[described.scalar_type]
        together = described.chunk[2]
        return box.layers(2, max(1, self._part_bytes // sheet_bytes // together) * together)
