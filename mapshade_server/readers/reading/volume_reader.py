"""What every volume reader offers, whatever the format behind it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.volume_files import VolumeFile
from volsplat.protocol.description.volume import SCALAR_BYTES, Box, VolumeDescription

Voxels = NDArray[Any]  # shaped (k, j, i), C-contiguous, native byte order, the source's own scalar type

# The scalar types that a volume may have, by their torch names, which are numpy's too.
SCALAR_TYPES = tuple(SCALAR_BYTES)


class VolumeReader(Protocol):
    """One opened volume. Both methods raise BadInput where the file turns out to be unusable."""

    def describe(self) -> VolumeDescription:
        """The grid, its place in space and the scalar type; no voxels are read where the format allows."""
        ...

    def read(self, box: Box) -> Voxels:
        """The voxels of `box`, which must lie within the grid."""
        ...


@runtime_checkable
class SecondScalarReader(VolumeReader, Protocol):
    """A volume with two numbers a voxel, such as amplitude and phase: its description has a `second_scalar`."""

    def read_second(self, box: Box) -> Voxels:
        """The second scalar in `box`, as `read` gives the first; NaN becomes the lowest of its range."""
        ...


@dataclass(frozen=True)
class OpenedVolume:
    """A reader whose voxels some function gives."""

    description: VolumeDescription
    read: Callable[[Box], Voxels]
    found_files: Callable[[], Sequence[VolumeFile]] = tuple  # where they are not what is named: see volume_files

    def describe(self) -> VolumeDescription:
        return self.description

    @property
    def files(self) -> Sequence[VolumeFile]:
        return self.found_files()
