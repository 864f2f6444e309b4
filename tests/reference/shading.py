"""The paper's shading rules in plain float64 torch (paper: "Shading"; signs and halves: design, sections 4 and 5)."""

import torch
from torch import Tensor

from reference import voxel_packets
from reference.plane import plane_table
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ColourTable, Field, ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.index_rules import grid_index_bytes
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, OPACITY_CODES, OPACITY_UNIT, code_of_opacity
from volsplat.protocol.rules.refinement import active_shading
from volsplat.protocol.rules.resolved_view import screen_rotation

GRID_FIELDS = (Field.GRID_I, Field.GRID_J, Field.GRID_K)
GRADIENT_FIELDS = (Field.GRADIENT_I, Field.GRADIENT_J, Field.GRADIENT_K)
SCREEN_FIELDS = (Field.SCREEN_X, Field.SCREEN_Y, Field.SCREEN_Z)
OPPOSITE = 1e-9  # the length of light plus eye, below which they are opposite but for rounding


def blocks(plan: FramePlan, indices: Tensor) -> tuple[Tensor, Tensor]:
    """Low (inclusive) and high (exclusive) of the clipped blocks of visited samples: int64 (n, 3) each."""
    low, high = [], []
    for axis in range(3):
        visits = plan.visits[axis]
        index = indices[:, axis]
        ordinal = (index - visits.first) // visits.stride
        start = index - visits.stride // 2
        low.append(torch.where(ordinal == 0, visits.low, start))
        high.append(torch.where(ordinal == visits.count - 1, visits.high, start + visits.stride))
    return torch.stack(low, -1), torch.stack(high, -1)


def opacity_exponents(plan: FramePlan, indices: Tensor) -> Tensor:
    """The t of 1 - (1 - a)^t for visited samples, by the class of their blocks: float64 (n,)."""
    block_class = torch.zeros(len(indices), dtype=torch.int64)
    for axis in (2, 1, 0):
        visits = plan.visits[axis]
        ordinal = (indices[:, axis] - visits.first) // visits.stride
        on_axis = torch.where(ordinal == 0, 0, torch.where(ordinal == visits.count - 1, 2, 1))
        block_class = 3 * block_class + on_axis
    return torch.tensor(plan.opacity_exponents, dtype=torch.float64)[block_class]


def field_bytes(
    plan: FramePlan, geometry: Geometry, directions: str, indices: Tensor, packets: Tensor
) -> dict[Field, Tensor]:
    """The bytes of all packet fields of visited samples.

    `indices` is int64 (n, 3) of grid i, j, k; `packets` int64 (n,); `directions` the direction scheme. Each
    result is int64 (n,).
    """
    low, high = blocks(plan, indices)
    doubled = low + high - 1
    code = packets >> DIRECTION_SHIFT & 0x7FFF
    fields = {Field.DENSITY: packets & 255, Field.STRENGTH: packets >> 8 & 255}
    gradient = voxel_packets.gradient_field_bytes(directions, geometry)
    for axis in range(3):
        fields[GRADIENT_FIELDS[axis]] = gradient[axis][code]
        dda = plan.screen_index[axis]
        h = dda.half_steps
        value = dda.origin + doubled[:, 0] * h[0] + doubled[:, 1] * h[1] + doubled[:, 2] * h[2]
        fields[SCREEN_FIELDS[axis]] = (value >> 32).clamp(0, 255)
        fields[GRID_FIELDS[axis]] = torch.tensor(grid_index_bytes(geometry.dims[axis]))[indices[:, axis]]
    return fields


def light_of_directions(scene: Scene, step: Step, directions: Tensor) -> Tensor:
    """What multiplies the reflected colour, for unit gradient directions (n, 3) or zeros: float64 (n,)."""
    active = active_shading(scene, step)
    to_physical = matrices.transposed(screen_rotation(scene.view))
    light = matrices.normalised(scene.light.direction)
    if scene.light.fixed_to == "world":
        light = matrices.applied(to_physical, light)
    eye = matrices.applied(to_physical, (0.0, 0.0, 1.0))
    between = matrices.plus(light, eye)
    half = matrices.normalised(between) if matrices.length(between) > OPPOSITE else (0.0, 0.0, 0.0)

    outward = -directions
    x, y, z = outward.unbind(-1)
    lambert = x * light[0] + y * light[1] + z * light[2]
    towards_half = x * half[0] + y * half[1] + z * half[2]
    if scene.shading.two_sided:
        lambert, towards_half = lambert.abs(), towards_half.abs()
    specular = torch.where(lambert > 0, towards_half.clamp(min=0) ** scene.shading.specular_power, 0.0)
    total = torch.zeros(len(directions), dtype=torch.float64)
    if active.diffuse:
        total = total + lambert.clamp(min=0)
    if active.specular:
        total = total + specular
    return torch.where(directions.abs().sum(-1) > 0, total, 0.0)


def shade(
    packets: Tensor,
    fields: dict[Field, Tensor],
    scene: Scene,
    step: Step,
    exponent: Tensor,
    directions: Tensor,
) -> tuple[Tensor, Tensor]:
    """Colour (n, 3) and opacity (n,) of samples, float64 0..1, unrounded; opacity is 0 if there is no data.

    `packets` int64 (n,); `fields` their bytes; `exponent` float64 (n,); `directions` (32768, 3) unit vectors.
    """
    alpha, emitted, reflected = looked_up(fields, scene)
    light = light_of_directions(scene, step, directions)[packets >> DIRECTION_SHIFT & 0x7FFF]
    colour = reflected * light[:, None]
    if active_shading(scene, step).emitted:
        colour = colour + emitted
    no_data = packets >> 31 & 1 == 1
    return colour.clamp(0, 1), torch.where(no_data, 0.0, thickened(alpha, exponent))


def looked_up(fields: dict[Field, Tensor], scene: Scene) -> tuple[Tensor, Tensor, Tensor]:
    """Opacity (n,) of one reference spacing, emitted and reflected colour (n, 3)."""
    return _by_plane(fields, scene) if scene.plane.patches else _by_tables(fields, scene)


def _by_tables(fields: dict[Field, Tensor], scene: Scene) -> tuple[Tensor, Tensor, Tensor]:
    tables, cross_bar = scene.tables, scene.cross_bar
    alpha = _scalars(tables.opac)[fields[cross_bar.opac]]
    if scene.shading.modulation:
        alpha = alpha * _scalars(tables.modu)[fields[cross_bar.modu]]
    return alpha, _colours(tables.emit)[fields[cross_bar.emit]], _colours(tables.refl)[fields[cross_bar.refl]]


def _by_plane(fields: dict[Field, Tensor], scene: Scene) -> tuple[Tensor, Tensor, Tensor]:
    table = plane_table(scene.plane.patches)
    at = fields[Field.STRENGTH], fields[Field.DENSITY]
    return table.opacity[at], table.emit[at], table.refl[at]


def thickened(alpha: Tensor, exponent: Tensor) -> Tensor:
    """1 - (1 - alpha)^exponent, without cancellation for thin fog."""
    return torch.where(exponent == 1.0, alpha, -torch.expm1(exponent * torch.log1p(-alpha)))


def opacity_codes(opacity: Tensor) -> Tensor:
    """The 12-bit codes of opacities (n,): int64."""
    return torch.tensor([code_of_opacity(value) for value in opacity.tolist()], dtype=torch.int64)


def opacity_values() -> Tensor:
    """The opacity of each of the 4096 codes, float64."""
    code = torch.arange(OPACITY_CODES)
    exponent, mantissa = code >> 8, code & 255
    units = torch.where(exponent == 0, mantissa, (256 + mantissa) << (exponent - 1).clamp(min=0))
    return units.to(torch.float64) / OPACITY_UNIT


def _colours(table: ColourTable) -> Tensor:
    return torch.tensor(table.entries(), dtype=torch.float64)


def _scalars(table: ScalarTable) -> Tensor:
    return torch.tensor(table.entries(), dtype=torch.float64)
