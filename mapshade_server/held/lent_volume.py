"""Files that only come whole: one server lends the volume that it has read, the others await their sub-cubes' parts."""

import time
from functools import partial
from typing import Any

import numpy as np

from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.readers import VolumeReader
from volsplat.mapshade_server.readers.reading.volume_reader import ReadBox, Voxels, read_scalars
from volsplat.protocol.description.volume import HALO, Box, VolumeDescription
from volsplat.protocol.messages.messages import AwaitParts, ScalarType, VolumePart
from volsplat.protocol.text.errors import BadInput


class LentVolume:
    """Reads like the file that it was read from. What it gives are copies: they do not keep it in memory."""

    def __init__(self, assignment: int, description: VolumeDescription, scalars: list[Voxels]) -> None:
        self.assignment = assignment
        self.description = description
        self._scalars = scalars

    @property
    def scalar_types(self) -> list[ScalarType]:
        """Of the values, and of the second scalar if there is one."""
        names: list[Any] = [values.dtype.name for values in self._scalars]
        return names

    def read(self, box: Box) -> Voxels:
        return self._read(0, box)

    @property
    def read_second(self) -> ReadBox | None:
        return partial(self._read, 1) if len(self._scalars) > 1 else None

    def part(self, part: VolumePart) -> memoryview:
        """A part's values as bytes. Raises BadInput for one that the volume does not have."""
        if part.scalar >= len(self._scalars) or self.scalar_types[part.scalar] != part.scalar_type:
            raise BadInput(f"the volume's scalars are {', '.join(self.scalar_types)}, not {part.scalar_type}")
        if not part.box.within(self.description.geometry.box):
            raise BadInput(f"part {part.box.low} to {part.box.high} reaches beyond the volume")
        values = np.ascontiguousarray(self._scalars[part.scalar][part.box.slices()])
        return values.data.cast("B")

    def _read(self, scalar: int, box: Box) -> Voxels:
        return self._scalars[scalar][box.slices()].copy()


def lent(reader: VolumeReader, assignment: int) -> LentVolume:
    """Read the whole of a volume, of which others get parts in this assignment.

    Raises BadInput if the file turns out to be unusable.
    """
    description = reader.description
    return LentVolume(assignment, description, read_scalars(reader, description.geometry.box))


class AwaitedParts:
    """The parts of one assignment that have come so far.

    Of each scalar of each sub-cube they come in order, i fastest, so that every voxel is there exactly once: a part is
    whole sheets, or whole rows of one sheet, or samples of one row, and begins at the first voxel that is missing.
    """

    def __init__(self, request: AwaitParts) -> None:
        self.assignment = request.assignment
        self.began = time.perf_counter()
        self._request = request
        dims = request.description.geometry.dims
        scalars = 1 if request.description.second_scalar is None else 2
        self._scalars = [  # by sub-cube, then by scalar: gradients of the first one need the halo
            [_Awaited(whole) for whole in (box.grown(HALO, dims), box)[:scalars]] for box in request.boxes
        ]

    @property
    def complete(self) -> bool:
        return all(awaited.complete for scalars in self._scalars for awaited in scalars)

    def take(self, part: VolumePart, values: memoryview) -> None:
        """Copy a part to its place. Raises BadInput for one that does not belong here, or not now."""
        if part.sub_cube >= len(self._scalars) or part.scalar >= len(self._scalars[part.sub_cube]):
            raise BadInput(f"part {part.box} of sub-cube {part.sub_cube} was not awaited")
        self._scalars[part.sub_cube][part.scalar].take(part, np.frombuffer(values, part.scalar_type))

    def sub_cubes(self) -> list[SubCube]:
        """All of them, once complete, with their values."""
        made, description = [], self._request.description
        for box, scalars in zip(self._request.boxes, self._scalars, strict=True):
            sub_cube = SubCube(description.geometry, box, description.second_scalar)
            sub_cube.hold(scalars[0].values, scalars[1].values if len(scalars) > 1 else None)
            made.append(sub_cube)
        return made


class _Awaited:
    """One scalar of one sub-cube."""

    def __init__(self, whole: Box) -> None:
        self._whole = whole
        self._values: Voxels | None = None
        self._count = 0  # of the voxels that are there: the first ones

    @property
    def complete(self) -> bool:
        return self._count == self._whole.voxels

    @property
    def values(self) -> Voxels:
        assert self._values is not None and self.complete, "parts are missing"
        return self._values

    def take(self, part: VolumePart, values: Voxels) -> None:
        self._check_place(part)
        if self._values is None:
            ni, nj, nk = self._whole.size
            self._values = np.empty((nk, nj, ni), values.dtype)
        if self._values.dtype != values.dtype:
            raise BadInput(f"parts of one sub-cube are {self._values.dtype} and {values.dtype}")
        self._values.reshape(-1)[self._count : self._count + len(values)] = values
        self._count += len(values)

    def _check_place(self, part: VolumePart) -> None:
        box, whole = part.box, self._whole
        (i, j, k), (ni, nj, nk) = (tuple(box.low[a] - whole.low[a] for a in range(3)), box.size)
        wi, wj, _ = whole.size
        in_one_piece = (ni, nj) == (wi, wj) or (ni == wi and nk == 1) or nj == nk == 1
        if not box.within(whole) or not in_one_piece:
            raise BadInput(f"part {box} of sub-cube {part.sub_cube} was not awaited")
        if (k * wj + j) * wi + i != self._count:
            raise BadInput(
                f"part {box} of sub-cube {part.sub_cube} is not the next one: it came before, or one is missing"
            )
