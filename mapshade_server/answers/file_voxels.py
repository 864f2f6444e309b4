"""Single voxels as their volume's file has them: whole numbers as such, floats in all their bits.

What lies around a voxel may have to be read as well, a compressed chunk or all of a file. If that is much it is left.
"""

import threading
from dataclasses import dataclass
from typing import Any

from volsplat.mapshade_server.answers.volume_answers import Answer, check_within
from volsplat.mapshade_server.held.volume_identity import check_still, described_volume
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, Voxels, read_scalars
from volsplat.program.machine_limits import available_memory
from volsplat.protocol.description.volume import SCALAR_BYTES, Box, Index, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages.value_messages import ReadVoxel, VoxelRead

MOST_BYTES = 1 << 26  # that are read and unpacked for one voxel
LEAST_LEFT = 8  # times as much memory as a file takes that is kept as a whole


@dataclass
class _Opened:
    path: str
    identity: VolumeIdentity
    reader: OpenedVolume
    whole: list[Voxels] | None = None  # both scalars, once they are here, of a volume that only comes whole

    def is_of(self, request: ReadVoxel) -> bool:
        return (self.path, self.identity) == (request.path, request.identity)


class FileVoxels:
    """Of one volume at a time, which is kept open for the next voxel. Any thread may read."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards what is open, and that one thread reads at a time
        self._opened: _Opened | None = None

    def read(self, request: ReadVoxel) -> Answer:
        """The voxel's numbers, or none if they are too dear.

        Raises BadInput if the volume has no such voxel, cannot be read, or is not the one any more that was described.
        """
        with self._lock:
            return self._told(request)

    def _told(self, request: ReadVoxel) -> Answer:
        opened = self._open(request)
        description = opened.reader.description
        voxel = _box_at(request.index)
        check_within([voxel], description.geometry)
        if not _is_cheap(description, opened.whole is not None):
            return Answer(VoxelRead(question=request.question, scalar_types=[]))
        scalars = _scalars(opened, description, voxel)
        check_still(request.path, opened.reader, request.identity)
        types: list[Any] = [scalar.dtype.name for scalar in scalars]
        in_order = (scalar.astype(scalar.dtype.newbyteorder("<")) for scalar in scalars)
        return Answer(
            VoxelRead(question=request.question, scalar_types=types),
            tuple(memoryview(scalar.tobytes()) for scalar in in_order),
        )

    def _open(self, request: ReadVoxel) -> _Opened:
        if self._opened is None or not self._opened.is_of(request):
            self._opened = None  # if what follows fails, nothing of another volume is kept
            reader = described_volume(request.path, request.identity)
            self._opened = _Opened(request.path, request.identity, reader)
        return self._opened


def _box_at(index: Index) -> Box:
    i, j, k = index
    return Box(index, (i + 1, j + 1, k + 1))


def _is_cheap(description: VolumeDescription, is_here: bool) -> bool:
    """Whether so little has to be read for a voxel that nobody misses it."""
    if description.reads_sub_cubes:
        ci, cj, ck = description.chunk
        return _bytes_of(description, ci * cj * ck) <= MOST_BYTES
    needed = _bytes_of(description, description.geometry.box.voxels)
    return is_here or (needed <= MOST_BYTES and LEAST_LEFT * needed <= available_memory())


def _bytes_of(description: VolumeDescription, voxels: int) -> int:
    scalars = 1 if description.second_scalar is None else 2
    return scalars * voxels * SCALAR_BYTES[description.scalar_type]


def _scalars(opened: _Opened, description: VolumeDescription, voxel: Box) -> list[Voxels]:
    if description.reads_sub_cubes:
        return read_scalars(opened.reader, voxel)
    if opened.whole is None:
        opened.whole = read_scalars(opened.reader, description.geometry.box)
    return [scalar[voxel.slices()] for scalar in opened.whole]
