"""Sub-cubes whose values come in parts from another server that has read the volume."""

import time

import numpy as np

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.description.volume import HALO, Box
from volsplat.protocol.messages.messages import AwaitParts, Part
from volsplat.protocol.text.errors import BadInput


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

    def take(self, part: Part, values: memoryview) -> None:
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

    def take(self, part: Part, values: Voxels) -> None:
        self._check_place(part)
        if self._values is None:
            ni, nj, nk = self._whole.size
            self._values = np.empty((nk, nj, ni), values.dtype)
        if self._values.dtype != values.dtype:
            raise BadInput(f"parts of one sub-cube are {self._values.dtype} and {values.dtype}")
        self._values.reshape(-1)[self._count : self._count + len(values)] = values
        self._count += len(values)

    def _check_place(self, part: Part) -> None:
        box, whole = part.box, self._whole
        (i, j, k), (ni, nj, nk) = (tuple(box.low[a] - whole.low[a] for a in range(3)), box.size)
        wi, wj, _ = whole.size
        inside = all(whole.low[a] <= box.low[a] and box.high[a] <= whole.high[a] for a in range(3))
        in_one_piece = (ni, nj) == (wi, wj) or (ni == wi and nk == 1) or nj == nk == 1
        if not inside or not in_one_piece:
            raise BadInput(f"part {box} of sub-cube {part.sub_cube} was not awaited")
        if (k * wj + j) * wi + i != self._count:
            raise BadInput(
                f"part {box} of sub-cube {part.sub_cube} is not the next one: it came before, or one is missing"
            )
