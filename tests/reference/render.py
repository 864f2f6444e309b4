"""The paper's renderer in plain float64: packets in, image out. This is the truth that the programs answer to.

The white edges are left out.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import torch
from torch import Tensor

from reference import combining, mapping, shading, voxel_packets
from reference.footprint import Footprint, footprint_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Order, Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import FramePlan, Reach, plan_frame
from volsplat.protocol.rules.grid_on_screen import FRACTION_BITS
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import Resolution
from volsplat.protocol.rules.packet_layout import OPACITY_CODES, SUBPIXEL_BITS, opacity_of_code
from volsplat.protocol.rules.resolved_view import resolved_zoom

LATTICE = 1 << SUBPIXEL_BITS
NEARLY_AN_EDGE = 1e-6  # voxels: where float64 might choose the wrong cell
CONTRIBUTIONS_AT_ONCE = 4_000_000  # (sample, pixel) pairs, which bounds the memory

# Weights (n, rows, columns) of samples at pixels x (n, columns) and y (n, rows).
Weights = Callable[[mapping.Samples, Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Rounding:
    """What is rounded as it is on the wire."""

    positions: bool = False
    colours: bool = False
    opacities: bool = False


EXACT, AS_ON_THE_WIRE = Rounding(), Rounding(positions=True, colours=True, opacities=True)


@dataclass(frozen=True)
class Shaded:
    """The samples of a frame that are not transparent, in traversal order, with what the shader made of them."""

    samples: mapping.Samples
    colour: Tensor  # (n, 3) float64, 0..1
    opacity: Tensor  # (n,) float64, 0..1


def render(
    packets: Tensor,
    geometry: Geometry,
    quantisation: Quantisation,
    scene: Scene,
    step: Step,
    exact: bool,
    weights: Weights | None = None,
    rounding: Rounding | None = None,
    resolution: Resolution | None = None,
) -> Tensor:
    """The image (H, W, 4) float64, associated alpha, of voxel packets (k, j, i) int64.

    Not `exact`: positions, colours and opacities are those of the wire, and `weights` may give the footprint table
    of the splat server. `exact`: nothing but the voxel packets is quantised; or of footprints what `rounding` says.
    """
    rounding = rounding or (EXACT if exact else AS_ON_THE_WIRE)
    plan = plan_frame(scene, geometry, step, resolution).upright
    shaded = shaded_samples(packets, geometry, quantisation, scene, plan, rounding)
    buffer = torch.zeros((plan.height * plan.width, 4), dtype=torch.float64)
    if plan.reach == Reach.CELL:
        _splat_cells(buffer, shaded, plan, scene, geometry, exact)
    elif plan.reach == Reach.PIXEL:
        _splat_pixels(buffer, shaded, plan, scene, exact)
    else:
        steps = mapping.steps_on_screen(scene, geometry)
        footprint = footprint_of(steps, resolved_zoom(scene, geometry), plan.strides, scene.reconstruction)
        _splat_footprints(buffer, shaded, plan, scene, footprint, rounding, weights)
    return buffer.reshape(plan.height, plan.width, 4)


def shaded_samples(
    packets: Tensor, geometry: Geometry, quantisation: Quantisation, scene: Scene, plan: FramePlan, rounding: Rounding
) -> Shaded:
    """Map and shade every visited sample; what is transparent or has no data is left out."""
    samples = mapping.samples_of(scene, geometry, plan)
    i, j, k = samples.indices.unbind(1)
    here = packets[k, j, i]
    fields = shading.field_bytes(plan, geometry, quantisation.directions, samples.indices, here)
    exponent = shading.opacity_exponents(plan, samples.indices)
    directions = voxel_packets.directions(quantisation.directions)
    colour, opacity = shading.shade(here, fields, scene, plan.step, exponent, directions)
    if rounding.colours:
        colour = torch.floor(255 * colour + 0.5) / 255
    if rounding.opacities:
        opacity = coded(opacity)
    kept = opacity > 0
    return Shaded(
        samples=samples.chosen(kept),
        colour=colour[kept],
        opacity=opacity[kept],
    )


def coded(opacity: Tensor) -> Tensor:
    """The nearest opacities (n,) that the 12-bit code can state."""
    codes = _code_opacities()
    return codes[torch.searchsorted((codes[1:] + codes[:-1]) / 2, opacity, right=True)]


@functools.cache
def _code_opacities() -> Tensor:
    return torch.tensor([opacity_of_code(code) for code in range(OPACITY_CODES)], dtype=torch.float64)


def _splat_footprints(
    buffer: Tensor,
    shaded: Shaded,
    plan: FramePlan,
    scene: Scene,
    footprint: Footprint,
    rounding: Rounding,
    weights: Weights | None,
) -> None:
    """Add every sample, weighted by its footprint at the pixel centres around it."""
    half_x, half_y = footprint.half_size
    columns, rows = torch.arange(int(2 * half_x) + 3), torch.arange(int(2 * half_y) + 3)
    at_once = max(CONTRIBUTIONS_AT_ONCE // (len(columns) * len(rows)), 1)
    positions = shaded.samples.lattice.double() / LATTICE if rounding.positions else shaded.samples.exact
    for start in range(0, len(positions), at_once):
        here = slice(start, start + at_once)
        x, y = positions[here].unbind(1)
        pixel_x = torch.floor(x - half_x).long()[:, None] + columns
        pixel_y = torch.floor(y - half_y).long()[:, None] + rows
        if weights is None:
            weight = footprint.weights((pixel_x - x[:, None])[:, None, :], (pixel_y - y[:, None])[:, :, None])
        else:
            weight = weights(shaded.samples.chosen(here), pixel_x, pixel_y)
        inside_x = (pixel_x >= 0) & (pixel_x < plan.width)
        inside_y = (pixel_y >= 0) & (pixel_y < plan.height)
        sample, row, column = torch.nonzero((weight > 0) & inside_x[:, None, :] & inside_y[:, :, None], as_tuple=True)
        combining.combine(
            scene.order,
            buffer,
            pixel_y[sample, row] * plan.width + pixel_x[sample, column],
            combining.weighted(weight[sample, row, column], shaded.opacity[here][sample]),
            shaded.colour[here][sample],
        )


def _splat_pixels(buffer: Tensor, shaded: Shaded, plan: FramePlan, scene: Scene, exact: bool) -> None:
    """Add every sample to the one pixel whose centre is nearest."""
    lattice = (shaded.samples.lattice + LATTICE // 2) >> SUBPIXEL_BITS
    nearest = torch.floor(shaded.samples.exact + 0.5).long() if exact else lattice
    x, y = nearest.unbind(1)
    inside = (x >= 0) & (x < plan.width) & (y >= 0) & (y < plan.height)
    pixel = (y * plan.width + x)[inside]
    combining.combine(scene.order, buffer, pixel, shaded.opacity[inside], shaded.colour[inside])


def _splat_cells(
    buffer: Tensor, shaded: Shaded, plan: FramePlan, scene: Scene, geometry: Geometry, exact: bool
) -> None:
    """Sheet by sheet, give every pixel the three samples in whose cells its ray enters, crosses and leaves the sheet.

    It crosses in the row where it leaves, the place along the row still being that where it entered.
    """
    counts = [plan.visits[axis].count for axis in plan.traversal.axes]
    # Visible samples by (sheet, row, sample); -1 where there is none.
    found = torch.full((counts[0], counts[1], counts[2]), -1, dtype=torch.int64)
    found[tuple(shaded.samples.ordinals.unbind(1))] = torch.arange(len(shaded.opacity))
    pixels, samples = [torch.zeros(0, dtype=torch.int64)], [torch.zeros(0, dtype=torch.int64)]
    for sheet in torch.unique(shaded.samples.ordinals[:, 0]).tolist():
        for row, sample in cells_on_the_way(plan, sheet, (scene, geometry) if exact else None):
            pixel = torch.nonzero((row >= 0) & (sample >= 0)).flatten()
            which = found[sheet, row[pixel], sample[pixel]]
            pixels.append(pixel[which >= 0])
            samples.append(which[which >= 0])
    which = torch.cat(samples)
    combining.combine(scene.order, buffer, torch.cat(pixels), shaded.opacity[which], shaded.colour[which])


def cells_on_the_way(
    plan: FramePlan, sheet: int, exact: tuple[Scene, Geometry] | None = None
) -> list[tuple[Tensor, Tensor]]:
    """The rows and samples (H * W,) of the cells that pixels' rays are in, in the order of traversal; -1 outside.

    By the plan's fixed point, or `exact` by its scene and geometry in real numbers.
    """
    visits = plan.visits[plan.traversal.axes[0]]
    low, high = visits.block(sheet if plan.traversal.ascending[0] else visits.count - 1 - sheet)
    to_viewer = plan.traversal.ascending[0] == (plan.order == Order.BACK_TO_FRONT)
    far, near = (2 * low - 1, 2 * high - 1) if to_viewer else (2 * high - 1, 2 * low - 1)
    on_face = [
        sheet_coordinates(plan, face, *exact) if exact else sheet_coordinates_by_dda(plan, face) for face in (far, near)
    ]
    (far_row, near_row), (far_sample, near_sample) = (
        [visit_at(grid[:, n], plan, n + 1) for grid in on_face] for n in range(2)
    )
    way = [(far_row, far_sample), (near_row, far_sample), (near_row, near_sample)]
    return way if plan.order == Order.BACK_TO_FRONT else way[::-1]


def pixel_centres(plan: FramePlan) -> Tensor:
    """(H * W, 2) int64: x and y."""
    y, x = torch.meshgrid(torch.arange(plan.height), torch.arange(plan.width), indexing="ij")
    return torch.stack((x.flatten(), y.flatten()), dim=1)


def sheet_coordinates(plan: FramePlan, doubled: int, scene: Scene, geometry: Geometry) -> Tensor:
    """The grid coordinates (H * W, 2) on the row and sample axes where the pixels' rays meet a plane of the sheet axis.

    `doubled` is twice the plane's index.
    """
    sheet_axis, row_axis, sample_axis = plan.traversal.axes
    corner = torch.zeros((1, 3), dtype=torch.float64)
    corner[0, sheet_axis] = doubled / 2
    steps = mapping.steps_on_screen(scene, geometry)[:2] * torch.tensor([[1.0], [-1.0]], dtype=torch.float64)
    back: Tensor = torch.linalg.inv(steps[:, [row_axis, sample_axis]])
    off: Tensor = pixel_centres(plan) - mapping.on_screen(corner, scene, geometry)
    grid: Tensor = off @ back.T
    return grid


def sheet_coordinates_by_dda(plan: FramePlan, doubled: int) -> Tensor:
    """As sheet_coordinates, by the plan's fixed point; where two cells meet, the exact fraction decides."""
    sheet_axis, row_axis, sample_axis = plan.traversal.axes
    origins = [dda.origin + doubled * dda.half_steps[sheet_axis] for dda in (plan.x, plan.y)]
    row_x, sample_x = plan.x.half_steps[row_axis], plan.x.half_steps[sample_axis]
    row_y, sample_y = plan.y.half_steps[row_axis], plan.y.half_steps[sample_axis]
    area = row_x * sample_y - row_y * sample_x
    off = (pixel_centres(plan) << FRACTION_BITS) - torch.tensor(origins)
    x, y = off.double().unbind(1)
    grid = torch.stack((x * sample_y - y * sample_x, y * row_x - x * row_y), dim=1) / float(2 * area)
    nearly_an_edge = ((grid - 0.5) - (grid - 0.5).round()).abs() < NEARLY_AN_EDGE
    for pixel in torch.nonzero(nearly_an_edge.any(dim=1)).flatten().tolist():
        off_x, off_y = off[pixel].tolist()
        grid[pixel, 0] = float(Fraction(off_x * sample_y - off_y * sample_x, 2 * area))
        grid[pixel, 1] = float(Fraction(off_y * row_x - off_x * row_y, 2 * area))
    return grid


def visit_at(coordinate: Tensor, plan: FramePlan, loop: int) -> Tensor:
    """The ordinal on a loop whose block holds each grid coordinate (n,), or -1: blocks are [low, high) - 1/2."""
    visits = plan.visits[plan.traversal.axes[loop]]
    edges = [visits.block(n)[0] - 0.5 for n in range(visits.count)] + [visits.high - 0.5]
    visit = torch.searchsorted(torch.tensor(edges, dtype=torch.float64), coordinate.contiguous(), right=True) - 1
    inside = (visit >= 0) & (visit < visits.count)
    ordinal = visit if plan.traversal.ascending[loop] else visits.count - 1 - visit
    return torch.where(inside, ordinal, -1)
