"""A whole volume in memory, from which the sub-cubes of all servers are taken: for files that only come whole."""

from typing import Any

import numpy as np

from volsplat.mapshade_server.readers import VolumeReader
from volsplat.mapshade_server.readers.reading.volume_reader import SecondScalarReader, Voxels
from volsplat.protocol.description.volume import Box, VolumeDescription
from volsplat.protocol.messages.messages import Part, ScalarType
from volsplat.protocol.text.errors import BadInput


class LentVolume:
    """Reads like the file that it was read from. What it gives are copies: they do not keep it in memory."""

    def __init__(self, description: VolumeDescription, values: Voxels) -> None:
        self._description = description
        self._scalars: list[Voxels] = [values]

    @property
    def scalar_types(self) -> list[ScalarType]:
        """Of the values, and of the second scalar if there is one."""
        names: list[Any] = [values.dtype.name for values in self._scalars]
        return names

    @property
    def nbytes(self) -> int:
        return sum(values.nbytes for values in self._scalars)

    def describe(self) -> VolumeDescription:
        return self._description

    def read(self, box: Box) -> Voxels:
        return self._scalars[0][box.slices()].copy()

    def part(self, part: Part) -> memoryview:
        """A part's values as bytes. Raises BadInput for one that the volume does not have."""
        if part.scalar >= len(self._scalars) or self.scalar_types[part.scalar] != part.scalar_type:
            raise BadInput(f"the volume's scalars are {', '.join(self.scalar_types)}, not {part.scalar_type}")
        if any(high > size for high, size in zip(part.box.high, self._description.geometry.dims, strict=True)):
            raise BadInput(f"part {part.box.low} to {part.box.high} reaches beyond the volume")
        values = np.ascontiguousarray(self._scalars[part.scalar][part.box.slices()])
        return values.data.cast("B")


class LentTwoScalars(LentVolume):
    """A lent volume that has a second scalar."""

    def __init__(self, description: VolumeDescription, values: Voxels, second: Voxels) -> None:
        super().__init__(description, values)
        self._scalars.append(second)

    def read_second(self, box: Box) -> Voxels:
        return self._scalars[1][box.slices()].copy()


def lent(reader: VolumeReader) -> LentVolume:
    """Read the whole of a volume. Raises BadInput if the file turns out to be unusable."""
    description = reader.describe()
    values = reader.read(description.geometry.box)
    if isinstance(reader, SecondScalarReader):
        return LentTwoScalars(description, values, reader.read_second(description.geometry.box))
    return LentVolume(description, values)
