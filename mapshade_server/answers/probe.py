"""What is seen under a point of the image: the front-most voxel of some sub-cubes that a frame would send."""

from collections.abc import Callable, Sequence

from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.frames.shading_tables import OpacityRule, opacity_rule
from volsplat.mapshade_server.held.sub_cube import SubCube, mixture_of
from volsplat.protocol.description.scene import GRADIENT_FIELDS, GRID_FIELDS, SCREEN_FIELDS, Field
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.messages import ProbedVoxel
from volsplat.protocol.rules.grid_on_screen import FRACTION_BITS
from volsplat.protocol.rules.levels import index_in_volume
from volsplat.protocol.rules.line_of_sight import LineOfSight
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT

FieldByte = Callable[[Index, int], int]  # of the voxel at this index with this packet


def front_most(sub_cubes: Sequence[SubCube], drawing: Drawing, line: LineOfSight) -> ProbedVoxel | None:
    """The front-most voxel under the line's point that is not transparent.

    The answer's index is the volume's; the sub-cubes are boxes of the level that is drawn.
    """
    is_visible = _visible_voxels(drawing, opacity_rule(drawing.shading, mixture_of(sub_cubes)))
    found = []
    for cube in sub_cubes:
        packets, (i0, j0, k0) = memoryview(cube.packets), cube.box.low
        for index in line.voxels(drawing.plan, cube.box):
            packet: int = packets[index[2] - k0, index[1] - j0, index[0] - i0]
            if is_visible(index, packet):
                found.append((index, packet))
                break
    if not found:
        return None
    index, packet = min(found, key=lambda voxel: drawing.plan.traversal.place(voxel[0]))
    return ProbedVoxel(
        index=index_in_volume(index, drawing.plan.factors, drawing.geometry.dims),
        density=drawing.quantisation.density_of_byte(packet & 255),
        strength=drawing.quantisation.strength_of_byte(packet >> 8 & 255),
    )


def _visible_voxels(drawing: Drawing, rule: OpacityRule) -> Callable[[Index, int], bool]:
    """Says whether a frame would send a voxel."""
    codes = memoryview(shading_tables.opacity_codes(rule, drawing.plan.opacity_exponents[0]))
    low, high = (_byte_of(field, drawing) for field in shading_tables.opacity_fields(rule))

    def is_visible(index: Index, packet: int) -> bool:
        return not packet >> NO_DATA_BIT and codes[low(index, packet) | high(index, packet) << 8] > 0

    return is_visible


def _byte_of(field: Field, drawing: Drawing) -> FieldByte:
    plan, geometry = drawing.plan, drawing.geometry
    if field == Field.DENSITY:
        return lambda index, packet: packet & 255
    if field == Field.STRENGTH:
        return lambda index, packet: packet >> 8 & 255
    if field in GRADIENT_FIELDS:
        axis = GRADIENT_FIELDS.index(field)
        components = memoryview(shading_tables.gradient_bytes(drawing.directions, geometry.index_to_physical))
        return lambda index, packet: components[axis, packet >> DIRECTION_SHIFT & 0x7FFF]
    if field in SCREEN_FIELDS:
        dda = plan.screen_index[SCREEN_FIELDS.index(field)]
        return lambda index, packet: min(max(dda.at_half_indices(_doubled(index)) >> FRACTION_BITS, 0), 255)
    axis = GRID_FIELDS.index(field)
    grid_bytes = shading_tables.grid_bytes(geometry.dims[axis], plan.factors[axis])
    return lambda index, packet: grid_bytes[index[axis]]


def _doubled(index: Index) -> Index:
    return (2 * index[0], 2 * index[1], 2 * index[2])
