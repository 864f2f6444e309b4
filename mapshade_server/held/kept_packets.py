"""Sub-cubes made out of those that are held: what is there already is copied, only the rest is read."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.level_mixture import LevelMixture
from volsplat.mapshade_server.held.packet_store import Packets, PacketStore
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.held.wanted_reader import GivenUp
from volsplat.mapshade_server.readers import VolumeReader
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import LISTS_PER_PACKET, LISTS_PER_STORED_PACKET

Read = Callable[[Box], Iterable[tuple[Box, Packets]]]  # the packets of a box, part by part


def stored_sub_cubes(
    store: PacketStore, level: int, boxes: Sequence[Box], held: Sequence[SubCube], given_up: Callable[[], bool]
) -> tuple[list[SubCube], int]:
    """Boxes of a level, and how many voxels were read for them. `held` are sub-cubes of the level.

    Beside these no more is held meanwhile than one sheet of bricks. Raises GivenUp if that is so, BadInput for damage.
    """
    _kernels.give_freed_memory_back()  # bricks are unpacked by many threads

    def read(box: Box) -> Iterable[tuple[Box, Packets]]:
        for sheet in box.layers(2, store.brick_size):
            if given_up():
                raise GivenUp
            yield sheet, store.read(level, sheet)

    return _sub_cubes(store.levels[level], boxes, held, read, LISTS_PER_STORED_PACKET, store.mixture(level))


def packed_sub_cubes(
    reader: VolumeReader, quantisation: Quantisation, boxes: Sequence[Box], held: Sequence[SubCube]
) -> tuple[list[SubCube], int]:
    """Boxes of a volume, and how many voxels were read for them. `held` are packed by the same rules."""
    description = reader.description

    def read(box: Box) -> Iterable[tuple[Box, Packets]]:
        part = SubCube(description.geometry, box, description.second_scalar)
        part.read(reader)
        part.pack(quantisation)
        yield box, _array(part)

    return _sub_cubes(description.geometry, boxes, held, read, LISTS_PER_PACKET)


def _sub_cubes(
    geometry: Geometry,
    boxes: Sequence[Box],
    held: Sequence[SubCube],
    read: Read,
    lists: float,
    mixture: LevelMixture | None = None,
) -> tuple[list[SubCube], int]:
    made, voxels_read = [], 0
    for box in boxes:
        cube = next((cube for cube in held if cube.box == box), None)  # with what a walk keeps of it
        if cube is None:
            packets, voxels = _gathered(box, held, read)
            cube, voxels_read = SubCube.of_packets(geometry, box, packets, lists, mixture), voxels_read + voxels
        made.append(cube)
    return made, voxels_read


def _gathered(box: Box, held: Sequence[SubCube], read: Read) -> tuple[Packets, int]:
    packets = np.asarray(memoryview(_kernels.empty_packets(box.size)))
    for cube in held:
        if (common := box.common(cube.box)) is not None:
            packets[common.slices(box.low)] = _array(cube)[common.slices(cube.box.low)]
    rest = box.without(*(cube.box for cube in held))
    for part in rest:
        for place, values in read(part):
            packets[place.slices(box.low)] = values
    return packets, sum(part.voxels for part in rest)


def _array(cube: SubCube) -> Packets:
    array: Packets = np.asarray(memoryview(cube.packets))
    return array
