"""Sub-cubes whose values come in parts from another server that has read the volume."""

import time

import numpy as np

from volsplat.mapshade_server.readers.volume_reader import Voxels
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.errors import BadInput
from volsplat.protocol.messages import AwaitParts, Part
from volsplat.protocol.volume import HALO, Box


class AwaitedParts:
    """The parts of one assignment that have come so far. Each comes once."""

    def __init__(self, request: AwaitParts) -> None:
        self.assignment = request.assignment
        self.began = time.perf_counter()
        self._request = request
        dims = request.description.geometry.dims
        scalars = 1 if request.description.second_scalar is None else 2
        self._boxes = [  # by sub-cube, then by scalar: gradients of the first one need the halo
            [box.grown(HALO, dims), box][:scalars] for box in request.boxes
        ]
        self._values: list[dict[int, Voxels]] = [{} for _ in request.boxes]
        self._missing = sum(box.voxels for boxes in self._boxes for box in boxes)

    @property
    def complete(self) -> bool:
        return self._missing <= 0

    def take(self, part: Part, values: memoryview) -> None:
        """Copy a part to its place. Raises BadInput for one that does not belong here."""
        whole = self._whole(part)
        dtype = np.dtype(part.scalar_type)
        held = self._values[part.sub_cube].get(part.scalar)
        if held is None:
            held = self._values[part.sub_cube][part.scalar] = np.empty(_shape(whole), dtype)
        if held.dtype != dtype:
            raise BadInput(f"parts of one sub-cube are {held.dtype} and {dtype}")
        low, size = part.box.low, part.box.size
        i, j, k = (slice(low[a] - whole.low[a], low[a] - whole.low[a] + size[a]) for a in range(3))
        held[k, j, i] = np.frombuffer(values, dtype).reshape(_shape(part.box))
        self._missing -= part.box.voxels

    def sub_cubes(self) -> list[SubCube]:
        """All of them, once complete, with their values."""
        made, description = [], self._request.description
        for box, scalars in zip(self._request.boxes, self._values, strict=True):
            sub_cube = SubCube(description.geometry, box, description.second_scalar)
            sub_cube.hold(scalars[0], scalars.get(1))
            made.append(sub_cube)
        return made

    def _whole(self, part: Part) -> Box:
        if part.sub_cube < len(self._boxes) and part.scalar < len(self._boxes[part.sub_cube]):
            whole = self._boxes[part.sub_cube][part.scalar]
            if all(whole.low[a] <= part.box.low[a] and part.box.high[a] <= whole.high[a] for a in range(3)):
                return whole
        raise BadInput(f"part {part.box} of sub-cube {part.sub_cube} was not awaited")


def _shape(box: Box) -> tuple[int, int, int]:
    ni, nj, nk = box.size
    return (nk, nj, ni)
