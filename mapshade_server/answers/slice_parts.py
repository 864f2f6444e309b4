"""What some sub-cubes hold of a slice of the volume: packets, and the colours in which they are drawn."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.answers.voxel_fields import VoxelFields
from volsplat.mapshade_server.held.sub_cube import SubCube, mixture_of
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.rules.slice_plane import SlicePlane

THICKNESS = 8.0  # reference spacings: one voxel of what is drawn like fog would have no colour that could be seen
LIGHT = 0.7  # of the reflected colour, as on a surface that stands aslant: in full light most would be white
LEVELS = 255  # of red, green, blue and opacity


def slice_parts(sub_cubes: Sequence[SubCube], drawing: Drawing, plane: SlicePlane) -> Iterator[tuple[Rectangle, bytes]]:
    """Each part of the slice that is held, with its samples' bytes as SliceRead has them.

    The plane is of the sub-cubes' grid. A colour is what is emitted and by LIGHT reflected, its opacity that of a layer
    of THICKNESS.
    """
    fields = VoxelFields(drawing, mixture_of(sub_cubes))
    for cube in sub_cubes:
        part = plane.part_in(cube.box)
        if part is not None:
            packets, index = _samples(cube, plane, part)
            yield part, packets.tobytes() + _colours(fields, index, packets).tobytes()


def _samples(cube: SubCube, plane: SlicePlane, part: Rectangle) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Packets (n,) and indices (n, 3), row by row."""
    first, second = plane.sides
    along = [np.array([plane.index])] * 3
    along[first] = _indices(plane, first, part.left, part.width)
    along[second] = _indices(plane, second, part.top, part.height)
    i, j, k = along
    held = np.asarray(memoryview(cube.packets))
    i0, j0, k0 = cube.box.low
    packets = held[np.ix_(k - k0, j - j0, i - i0)].reshape(-1).astype("<u4")
    places = np.stack(np.meshgrid(k, j, i, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    return packets, places.astype(np.int64)


def _indices(plane: SlicePlane, axis: int, begin: int, count: int) -> NDArray[np.int64]:
    return np.array([plane.sample_index(sample, axis) for sample in range(begin, begin + count)], dtype=np.int64)


def _colours(fields: VoxelFields, index: NDArray[np.int64], packets: NDArray[np.uint32]) -> NDArray[np.uint8]:
    emitted, reflected = fields.colours(index, packets)
    opacity = fields.opacity(index, packets, THICKNESS)
    colours = np.concatenate((np.minimum(emitted + LIGHT * reflected, 1.0), opacity[:, None]), axis=1)
    levels: NDArray[np.uint8] = (colours * LEVELS + 0.5).astype(np.uint8)
    return levels
