"""What a level is packed from: values, a second scalar if the volume has one, and gradients if it is a coarser one."""

from dataclasses import dataclass
from threading import Lock
from typing import NamedTuple

from volsplat.mapshade_server.prepare.level_source import LevelSource
from volsplat.mapshade_server.readers.reading.volume_reader import ReadBox, VolumeReader, Voxels
from volsplat.protocol.description.volume import Box, Index


class BlockScalars(NamedTuple):
    """What was read, or is to be written, of a block."""

    values: Voxels
    second: Voxels | None
    gradients: Voxels | None = None  # in the bits of packets, see gradient_means


@dataclass(frozen=True)
class Scalars:
    """`second_range` is what the second scalar lies in, `chunk` how many voxels along i, j, k only come together.

    Without `gradients` they are taken between the values.
    """

    values: ReadBox
    second: ReadBox | None
    second_range: tuple[float, float] | None
    chunk: Index
    gradients: ReadBox | None = None

    def read(self, box: Box, around: Box) -> BlockScalars:
        """The values of `around`, the rest of `box`: gradients of the values alone need a halo."""
        second, gradients = (None if one is None else one(box) for one in (self.second, self.gradients))
        return BlockScalars(self.values(around), second, gradients)


@dataclass(frozen=True)
class StoredScalars(Scalars):
    """Scalars in raw files beside the store."""

    values: LevelSource
    second: LevelSource | None
    gradients: LevelSource | None = None

    def write(self, box: Box, block: BlockScalars) -> None:
        """Lays down a box for good."""
        self.values.write(box, block.values)
        if self.second is not None and block.second is not None:
            self.second.write(box, block.second)
        if self.gradients is not None and block.gradients is not None:
            self.gradients.write(box, block.gradients)


def volume_scalars(reader: VolumeReader) -> Scalars:
    """Those of a volume's own reader, for several threads: readers need not bear two at once."""
    lock = Lock()

    def by_turns(read: ReadBox) -> ReadBox:
        def read_alone(box: Box) -> Voxels:
            with lock:
                return read(box)

        return read_alone

    second = None if reader.read_second is None else by_turns(reader.read_second)
    described = reader.description
    return Scalars(by_turns(reader.read), second, described.second_scalar, described.chunk)
