"""What is seen under a point of the image: the front-most voxel of some sub-cubes that a frame would send."""

from collections.abc import Callable, Sequence

from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.frames.shading_tables import OpacityRule, opacity_rule
from volsplat.mapshade_server.held.sub_cube import SubCube, mixture_of
from volsplat.protocol.description.scene import GRADIENT_FIELDS, GRID_FIELDS, SCREEN_FIELDS, Field
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.messages.messages import ProbedVoxel
from volsplat.protocol.rules.grid_on_screen import FRACTION_BITS
from volsplat.protocol.rules.index_rules import DirectionCode, Quantisation
from volsplat.protocol.rules.levels import index_in_volume
from volsplat.protocol.rules.line_of_sight import LineOfSight
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT
from volsplat.protocol.rules.shading_rule import ShadingRule

FieldByte = Callable[[Index, int], int]  # of the voxel at this index with this packet


def front_most(
    sub_cubes: Sequence[SubCube],
    geometry: Geometry,
    quantisation: Quantisation,
    shading: ShadingRule,
    line: LineOfSight,
) -> ProbedVoxel | None:
    """The front-most voxel under the line's point that is not transparent, from sub-cubes packed by these rules.

    `geometry` is the volume's, and so is the answer's index; the sub-cubes are boxes of the level of the line.
    """
    is_visible = _visible_voxels(geometry, quantisation, opacity_rule(shading, mixture_of(sub_cubes)), line)
    found = []
    for cube in sub_cubes:
        packets, (i0, j0, k0) = memoryview(cube.packets), cube.box.low
        for index in line.voxels(cube.box):
            packet: int = packets[index[2] - k0, index[1] - j0, index[0] - i0]
            if is_visible(index, packet):
                found.append((index, packet))
                break
    if not found:
        return None
    index, packet = min(found, key=lambda voxel: line.place(voxel[0]))
    return ProbedVoxel(
        index=index_in_volume(index, line.plan.factors, geometry.dims),
        density=quantisation.density_of_byte(packet & 255),
        strength=quantisation.strength_of_byte(packet >> 8 & 255),
    )


def _visible_voxels(
    geometry: Geometry, quantisation: Quantisation, rule: OpacityRule, line: LineOfSight
) -> Callable[[Index, int], bool]:
    """Says whether a frame would send a voxel."""
    codes = memoryview(shading_tables.opacity_codes(rule, line.plan.opacity_exponents[0]))
    low, high = (
        _byte_of(field, geometry, quantisation.directions_at(line.plan.factors), line)
        for field in shading_tables.opacity_fields(rule)
    )

    def is_visible(index: Index, packet: int) -> bool:
        return not packet >> NO_DATA_BIT and codes[low(index, packet) | high(index, packet) << 8] > 0

    return is_visible


def _byte_of(field: Field, geometry: Geometry, directions: DirectionCode, line: LineOfSight) -> FieldByte:
    if field == Field.DENSITY:
        return lambda index, packet: packet & 255
    if field == Field.STRENGTH:
        return lambda index, packet: packet >> 8 & 255
    if field in GRADIENT_FIELDS:
        axis = GRADIENT_FIELDS.index(field)
        components = memoryview(shading_tables.gradient_bytes(directions, geometry.index_to_physical))
        return lambda index, packet: components[axis, packet >> DIRECTION_SHIFT & 0x7FFF]
    if field in SCREEN_FIELDS:
        dda = line.plan.screen_index[SCREEN_FIELDS.index(field)]
        return lambda index, packet: min(max(dda.at_half_indices(_doubled(index)) >> FRACTION_BITS, 0), 255)
    axis = GRID_FIELDS.index(field)
    grid_bytes = shading_tables.grid_bytes(geometry.dims[axis], line.plan.factors[axis])
    return lambda index, packet: grid_bytes[index[axis]]


def _doubled(index: Index) -> Index:
    return (2 * index[0], 2 * index[1], 2 * index[2])
