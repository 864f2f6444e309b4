"""What is seen under a point of the image: the front-most voxel of some sub-cubes that a frame would send."""

from collections.abc import Sequence
from itertools import islice

import numpy as np

from volsplat.mapshade_server.answers.voxel_fields import VoxelFields
from volsplat.mapshade_server.held.sub_cube import SubCube, mixture_of
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.messages import ProbedVoxel
from volsplat.protocol.rules.levels import index_in_volume
from volsplat.protocol.rules.line_of_sight import LineOfSight
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT

AT_FIRST = 16  # voxels of a line that are looked at together, and then twice as many: the first are often seen


def front_most(sub_cubes: Sequence[SubCube], drawing: Drawing, line: LineOfSight) -> ProbedVoxel | None:
    """The front-most voxel under the line's point that is not transparent.

    The answer's index is the volume's; the sub-cubes are boxes of the level that is drawn.
    """
    fields = VoxelFields(drawing, mixture_of(sub_cubes))
    found = [voxel for cube in sub_cubes if (voxel := _first_visible(cube, fields, line)) is not None]
    if not found:
        return None
    index, packet = min(found, key=lambda voxel: drawing.plan.traversal.place(voxel[0]))
    return ProbedVoxel(
        index=index_in_volume(index, drawing.plan.factors, drawing.geometry.dims),
        density=drawing.quantisation.density_of_byte(packet & 255),
        strength=drawing.quantisation.strength_of_byte(packet >> 8 & 255),
    )


def _first_visible(cube: SubCube, fields: VoxelFields, line: LineOfSight) -> tuple[Index, int] | None:
    """Along the line the first voxel that a frame would send, with its packet."""
    plan, held = fields.drawing.plan, np.asarray(memoryview(cube.packets))
    voxels, together = line.voxels(plan, cube.box), AT_FIRST
    while some := list(islice(voxels, together)):
        index = np.array(some, np.int64)
        packets = held[tuple((index - cube.box.low).T[::-1])]
        seen = fields.opacity_codes(index, packets, plan.opacity_exponents[0]) > 0
        seen &= packets >> np.uint32(NO_DATA_BIT) == 0
        if seen.any():
            first = int(seen.argmax())
            return some[first], int(packets[first])
        together *= 2
    return None
