"""Step G in plain float64: densities on planes parallel to the screen, then colour and opacity of the slabs between.

After Mueller and Crawfis 1998, Mueller, Möller and Crawfis 1999 and Engel et al. 2001; see protocol/rules/slab_shape.py
for what the words mean. Every voxel is added up, whether anything can be seen near it or not. The white edges are left
out.
"""

import math
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from reference import mapping
from reference.combining import FROZEN_ALPHA
from reference.footprint import integral
from reference.plane import plane_table
from reference.shading import OPPOSITE
from reference.slab_kernels import slab_density
from reference.slab_light import BlockLight, block_light
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene, SlabKernel
from volsplat.protocol.description.shading_tables import ColourTable, Field, ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.grid_on_screen import FRACTION_BITS
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.packet_layout import DEPTH_BITS, NO_DATA_BIT, SUBPIXEL_BITS
from volsplat.protocol.rules.refinement import active_shading
from volsplat.protocol.rules.resolved_view import resolved_zoom, screen_rotation
from volsplat.protocol.rules.slab_kernels import COEFFICIENTS, LEAST_KNOWN, SLAB_RADIUS
from volsplat.protocol.rules.slab_shape import SlabShape

UNIT, SIGNED_UNIT, WIDE_UNIT = 3000, 1200, 1 << 26  # that integer weights sum to
LEAST_NARROW_GAIN = 0.25
MOST_OPAQUE = 1 - 1 / 4096
ABOVE_TIE = 2.0**-20  # voxels: what lies half-way between two belongs to the upper one, however rounded
THINNEST = 1e-6  # part of a slab in which all is that shows


@dataclass(frozen=True)
class Planes:
    """Sums on all planes and one more at either end, with so many more lines and columns around the image as gradients
    look aside."""

    weights: Tensor  # (planes + 2, lines, columns)
    densities: Tensor  # times weights
    unit: float  # what weights sum to
    least_known: float  # of it: where weights sum to less, nothing is known

    @property
    def known(self) -> Tensor:
        return self.weights >= math.floor(self.least_known * self.unit)

    @property
    def density(self) -> Tensor:
        return (self.densities / self.weights.clamp(min=1e-300)).clamp(0, 255)


def render(packets: Tensor, geometry: Geometry, quantisation: Quantisation, scene: Scene, exact: bool) -> Tensor:
    """The image (H, W, 4) float64, associated alpha, of voxel packets (k, j, i) int64.

    `exact`: neither positions nor weights are quantised; else they are integers, as on the wire and in the table.
    """
    plan = plan_frame(scene, geometry, Step.G)
    assert plan.slabs is not None
    planes = reconstructed(packets, geometry, scene, plan, plan.slabs, exact)
    light = block_light(packets, geometry, quantisation, scene)
    image = torch.zeros((plan.height, plan.width, 4), dtype=torch.float64)
    for slab in range(plan.slabs.planes - 1):
        colour, opacity = _shaded(planes, slab, geometry, quantisation, scene, plan, plan.slabs, light)
        alpha = image[..., 3:]
        more = (1 - alpha) * opacity[..., None] * torch.cat((colour, torch.ones_like(alpha)), dim=-1)
        image = torch.where(alpha >= FROZEN_ALPHA, image, image + more)
    return image


def reconstructed(
    packets: Tensor, geometry: Geometry, scene: Scene, plan: FramePlan, slabs: SlabShape, exact: bool
) -> Planes:
    """What the kernels of all voxels sum to on the planes."""
    k, j, i = torch.meshgrid(*map(torch.arange, packets.shape), indexing="ij")
    indices = torch.stack((i, j, k), dim=-1).reshape(-1, 3)[packets.flatten() >> NO_DATA_BIT == 0]
    density = (packets & 255)[indices[:, 2], indices[:, 1], indices[:, 0]].double()
    position = _positions(indices, geometry, scene, plan, slabs, exact) + torch.tensor((0, 0, 1))
    aside, before = slabs.baseline, [math.ceil(extent) for extent in slabs.half_extents]
    form, gain = _form(scene, geometry)
    narrow = SIGNED_UNIT if scene.reconstruction.slab_kernel in COEFFICIENTS else UNIT
    unit = 1.0 if exact else WIDE_UNIT if gain < LEAST_NARROW_GAIN else narrow
    shape = (slabs.planes + 2, plan.height + 2 * aside, plan.width + 2 * aside)
    weights, densities = (torch.zeros(math.prod(shape), dtype=torch.float64) for _ in range(2))
    box = torch.cartesian_prod(*(torch.arange(-n, n + 2) for n in before))  # (m, 3) of x, y and plane
    first = position.floor().long()
    for part in torch.split(torch.arange(len(indices)), max(1, 100_000 // len(box))):
        off = (first - position)[part, None] + box
        rho = torch.einsum("nma,nma->nm", off @ form, off).clamp(min=0).sqrt()
        within = rho < SLAB_RADIUS[scene.reconstruction.slab_kernel]
        voxel, offset = within.nonzero(as_tuple=True)
        x, y, plane = (first[part[voxel]] + box[offset] + torch.tensor((aside, aside, 0))).unbind(dim=-1)
        inside = (0 <= x) & (x < shape[2]) & (0 <= y) & (y < shape[1]) & (0 <= plane) & (plane < shape[0])
        weight = unit * gain * _kernel(scene, rho[within][inside])
        weight = weight if exact else (weight + 0.5).floor()
        at = ((plane * shape[1] + y) * shape[2] + x)[inside]
        weights.index_add_(0, at, weight)
        densities.index_add_(0, at, weight * density[part[voxel]][inside])
    least_known = LEAST_KNOWN[scene.reconstruction.slab_kernel]
    return Planes(weights.reshape(shape), densities.reshape(shape), unit, least_known)


def _positions(
    indices: Tensor, geometry: Geometry, scene: Scene, plan: FramePlan, slabs: SlabShape, exact: bool
) -> Tensor:
    """(n, 3) float64: pixels right, pixels down, and planes from plane 0."""
    if exact:
        middle = (torch.tensor(geometry.dims, dtype=torch.float64) - 1) / 2
        spacing = scene.reconstruction.slab * resolved_zoom(scene, geometry)
        depth = -((indices - middle) @ mapping.steps_on_screen(scene, geometry)[2]) / spacing
        # The middle of the volume lies on a plane
        doubled = geometry.dims[0] - 1, geometry.dims[1] - 1, geometry.dims[2] - 1
        depth = depth + round(slabs.depth.at_half_indices(doubled) / 2**FRACTION_BITS)
        return torch.cat((mapping.on_screen(indices.double(), scene, geometry), depth[:, None]), dim=1)
    doubled_indices, nearest = 2 * indices, torch.full((len(indices),), (1 << 31) + (1 << 25))
    finer, offsets = SUBPIXEL_BITS - slabs.offset_bits, 1 << slabs.offset_bits
    half = (1 << finer) // 2
    x, y = (
        ((mapping.on_lattice(dda, doubled_indices, nearest) + half) >> finer).double() / offsets
        for dda in (plan.x, plan.y)
    )
    fixed = slabs.depth.origin + (doubled_indices * torch.tensor(slabs.depth.half_steps)).sum(dim=1)
    bits = FRACTION_BITS - DEPTH_BITS
    return torch.stack((x, y, ((fixed + (1 << (bits - 1))) >> bits).double() / (1 << DEPTH_BITS)), dim=1)


def _form(scene: Scene, geometry: Geometry) -> tuple[Tensor, float]:
    """rho^2 as a form of pixels right, pixels down and planes behind (3, 3), and what keeps sums 1."""
    steps = mapping.steps_on_screen(scene, geometry)
    spacing = scene.reconstruction.slab * resolved_zoom(scene, geometry)
    covariance = steps @ steps.T
    squares, axes = torch.linalg.eigh(covariance[:2, :2])
    widened = covariance.clone()
    widened[:2, :2] = axes @ torch.diag(squares.clamp(min=1.0)) @ axes.T
    widened[2, 2] = widened[2, 2].clamp(min=spacing**2)
    gain = (torch.linalg.det(covariance) / torch.linalg.det(widened)).sqrt()
    flipped = torch.diag(torch.tensor([1.0, -1.0, -spacing], dtype=torch.float64))  # to screen, y up
    return flipped @ torch.linalg.inv(widened) @ flipped, float(gain)


def _kernel(scene: Scene, rho: Tensor) -> Tensor:
    """The kernel of unit integral over space, at distances within its radius."""
    kernel = scene.reconstruction.slab_kernel
    return slab_density(kernel, rho) / _over_space(kernel)


@cache
def _over_space(kernel: SlabKernel) -> Tensor:
    end = torch.tensor([SLAB_RADIUS[kernel]], dtype=torch.float64)
    return integral(lambda r: 4 * math.pi * r**2 * slab_density(kernel, r), end)


def _shaded(
    planes: Planes,
    slab: int,
    geometry: Geometry,
    quantisation: Quantisation,
    scene: Scene,
    plan: FramePlan,
    slabs: SlabShape,
    light: BlockLight,
) -> tuple[Tensor, Tensor]:
    """Colour (H, W, 3) and opacity (H, W) of a slab."""
    aside = slabs.baseline
    inner = (slice(aside, aside + plan.height), slice(aside, aside + plan.width))
    known = planes.known[slab + 1 : slab + 3][:, *inner]
    density = planes.density[slab + 1 : slab + 3][:, *inner]
    front = torch.where(known[0], density[0], density[1])
    back = torch.where(known[1], density[1], density[0])
    begin, end = _clipped(slab, geometry, scene, plan, slabs)
    drawn = known.any(dim=0) & (begin < end)
    rise = back - front
    one, other = front + (begin - slab) * rise, front + (end - slab) * rise
    on_front, on_back = _gradients(planes, slab, geometry, scene, aside, inner)
    ends = (on_front + (at - slab)[..., None] * (on_back - on_front) for at in (begin, end))
    place = _grid_coordinates(geometry, scene, plan, slabs, (begin + end) / 2)
    # From here on the pixels that are drawn (n), since each has 256 entries of every table.
    one, other, place, first, last = (values[drawn] for values in (one, other, place, *ends))
    gradient = (first + last) / 2
    fields = _fields(one, other, gradient, place, geometry, quantisation, plan)
    shares = _shares(one, other)
    if scene.plane.patches:
        depth, emitted, reflected = _by_plane(scene, fields, shares)
    else:
        depth = (_depths(scene, fields) * shares).sum(dim=-1)
        emitted, reflected = (_colour(scene, table, fields, shares) for table in ("emit", "refl"))
    depth = depth * scene.reconstruction.slab * (end - begin)[drawn]
    part, share = _lit(scene, first, last, *_shown(scene, fields, one, other, shares), depth)
    lit = share * _light(first + part[..., None] * (last - first), scene)
    active = active_shading(scene, Step.G)
    lamp, sky = light.at(place, gradient)
    seen = reflected * (lit * (1 - scene.light.shadows * (1 - lamp)))[..., None]
    if active.emitted:
        seen = seen + emitted
    open_sky = (2 * sky).clamp(max=1)  # half of it is, on a plane
    left = _dimming(gradient, place, scene, plan) * (1 - scene.light.occlusion * (1 - open_sky))
    colour, opacity = torch.zeros((*drawn.shape, 3), dtype=torch.float64), torch.zeros_like(begin)
    colour[drawn] = (seen * left[..., None]).clamp(0, 1)
    opacity[drawn] = -torch.expm1(-depth)
    return colour, opacity


def _pixels(plan: FramePlan) -> Tensor:
    """(H, W, 2): x and y of each pixel."""
    y, x = torch.meshgrid(torch.arange(plan.height), torch.arange(plan.width), indexing="ij")
    return torch.stack((x, y), dim=-1).double()


def _grid_coordinates(geometry: Geometry, scene: Scene, plan: FramePlan, slabs: SlabShape, depth: Tensor) -> Tensor:
    """(H, W, 3): i, j, k at a depth (H, W) in each pixel."""
    steps = mapping.steps_on_screen(scene, geometry)
    middle = (torch.tensor(geometry.dims, dtype=torch.float64) - 1) / 2
    spacing = scene.reconstruction.slab * resolved_zoom(scene, geometry)
    doubled = geometry.dims[0] - 1, geometry.dims[1] - 1, geometry.dims[2] - 1
    at_middle = round(slabs.depth.at_half_indices(doubled) / 2**FRACTION_BITS)
    off = _pixels(plan) - mapping.on_screen(middle[None], scene, geometry)
    up = torch.stack((off[..., 0], -off[..., 1], (at_middle - depth) * spacing), dim=-1)
    place: Tensor = middle + up @ torch.linalg.inv(steps).T
    return place


def _clipped(slab: int, geometry: Geometry, scene: Scene, plan: FramePlan, slabs: SlabShape) -> tuple[Tensor, Tensor]:
    """Where each pixel's ray enters and leaves the bounds within the slab (H, W), in planes."""
    zero = torch.zeros((plan.height, plan.width), dtype=torch.float64)
    start = _grid_coordinates(geometry, scene, plan, slabs, zero)
    step = _grid_coordinates(geometry, scene, plan, slabs, zero + 1) - start
    begin, end = zero + slab, zero + slab + 1
    for axis in range(3):
        high = geometry.dims[axis] if scene.bounds.high[axis] == -1 else scene.bounds.high[axis]
        ends = [(bound - 0.5 - start[..., axis]) / step[..., axis] for bound in (scene.bounds.low[axis], high)]
        across = step[..., axis].abs() < 1e-12
        inside = (start[..., axis] >= scene.bounds.low[axis] - 0.5) & (start[..., axis] <= high - 0.5)
        nearest, farthest = torch.minimum(*ends), torch.maximum(*ends)
        begin = torch.where(across, torch.where(inside, begin, math.inf), torch.maximum(begin, nearest))
        end = torch.where(across, end, torch.minimum(end, farthest))
    return begin.clamp(max=slab + 1), torch.maximum(end, begin.clamp(max=slab + 1))


def _gradients(
    planes: Planes, slab: int, geometry: Geometry, scene: Scene, aside: int, inner: tuple[slice, slice]
) -> tuple[Tensor, Tensor]:
    """(H, W, 3) along physical axes, on the two planes of a slab: central differences, else one-sided ones."""
    density, known = planes.density[slab : slab + 4], planes.known[slab : slab + 4]
    here, here_known = density[:, *inner], known[:, *inner]
    across = []
    for dx, dy in ((aside, 0), (0, aside)):
        moved = []
        for way in (-1, 1):
            there = (
                slice(None),
                *(slice(s.start + way * d, s.stop + way * d) for s, d in zip(inner, (dy, dx), strict=True)),
            )
            moved.append((torch.where(known[there], density[there], here), known[there]))
        (low, low_known), (high, high_known) = moved
        sides = low_known.double() + high_known.double()
        across.append((high - low) / (aside * sides.clamp(min=1)))
    both = here_known[1] & here_known[2]
    rise = torch.where(both, here[2] - here[1], 0.0)
    pixels = resolved_zoom(scene, geometry) / geometry.reference_spacing  # a unit of length
    spacing = scene.reconstruction.slab * resolved_zoom(scene, geometry)
    rotation = torch.tensor(screen_rotation(scene.view), dtype=torch.float64)
    found = []
    for here_at, other_at, low_at, high_at in ((1, 2, 0, 2), (2, 1, 1, 3)):
        right, down = (torch.where(here_known[here_at], slope[here_at], slope[other_at]) for slope in across)
        central = both & here_known[low_at] & here_known[high_at]
        behind = torch.where(central, (here[high_at] - here[low_at]) / 2, rise)
        found.append(torch.stack((right, -down, -behind / spacing), dim=-1) * pixels @ rotation)
    return found[0], found[1]


def _fields(
    one: Tensor,
    other: Tensor,
    gradient: Tensor,
    place: Tensor,
    geometry: Geometry,
    quantisation: Quantisation,
    plan: FramePlan,
) -> dict[Field, Tensor]:
    """The bytes (n) that index the tables."""
    size = torch.linalg.vector_norm(gradient, dim=-1)
    strength = size * quantisation.strength_scale / quantisation.density_scale
    found = {
        Field.DENSITY: ((one + other) / 2 + 0.5).floor().clamp(0, 255).long(),
        Field.STRENGTH: (strength.clamp(max=255) + 0.5).floor().long(),
    }
    for axis, letter in enumerate("ijk"):
        along = torch.tensor(
            matrices.normalised(matrices.column(geometry.index_to_physical, axis)), dtype=torch.float64
        )
        component = torch.where(size < 1e-9, 0.0, gradient @ along / size.clamp(min=1e-300))
        found[Field(f"gradient-{letter}")] = (128.5 + 127 * component).floor().clamp(0, 255).long()
        index = (place[..., axis] + 0.5 + ABOVE_TIE).floor().clamp(0, geometry.dims[axis] - 1)
        found[Field(f"grid-{letter}")] = (256 * index / geometry.dims[axis]).floor().long()
    for dda, letter in zip(plan.screen_index, "xyz", strict=True):
        value = (dda.origin + place @ (2 * torch.tensor(dda.half_steps, dtype=torch.float64))) / 2**FRACTION_BITS
        found[Field(f"screen-{letter}")] = value.floor().clamp(0, 255).long()
    return found


def _span(one: Tensor, other: Tensor) -> tuple[Tensor, Tensor]:
    """What two densities (n) enclose of the table."""
    middle, half = (one + other) / 2 + 0.5, ((other - one).abs() / 2).clamp(min=0.5)
    return (middle - half).clamp(0, 255.5), (middle + half).clamp(0.5, 256)


def _shares(one: Tensor, other: Tensor) -> Tensor:
    """(n, 256): each entry's share of those between two densities.

    Entry n of a table lies from n to n + 1; they are one entry wide at least.
    """
    low, high = _span(one, other)
    cell = torch.arange(256, dtype=torch.float64)
    within = (torch.minimum(high[..., None], cell + 1) - torch.maximum(low[..., None], cell)).clamp(min=0)
    return within / (high - low)[..., None]


def _shown(
    scene: Scene, fields: dict[Field, Tensor], one: Tensor, other: Tensor, shares: Tensor
) -> tuple[Tensor, Tensor]:
    """How far through a slab what shows begins, and how far it goes (n): spread evenly around its middle.

    By the depth that density alone gives, of which that of an entry lies in the entry's middle.
    """
    if scene.plane.patches:
        depths = -torch.log1p(-plane_table(scene.plane.patches).opacity.clamp(max=MOST_OPAQUE))[fields[Field.STRENGTH]]
    else:
        depths = -torch.log1p(-_opacity(scene, None).clamp(max=MOST_OPAQUE))
    low, high = _span(one, other)
    depth = shares * depths
    whole = depth.sum(dim=-1)
    place = depth @ (torch.arange(256, dtype=torch.float64) + 0.5) / whole.clamp(min=1e-300)
    risen = torch.where(whole < 1e-12, 0.5, ((place - low) / (high - low)).clamp(0, 1))
    middle = torch.where(other < one, 1 - risen, risen)
    half = torch.minimum(middle, 1 - middle).clamp(min=THINNEST / 2)
    return middle - half, 2 * half


def _lit(
    scene: Scene, first: Tensor, last: Tensor, begin: Tensor, width: Tensor, depth: Tensor
) -> tuple[Tensor, Tensor]:
    """How far through a slab what is seen of it and lit has its middle, and its share of what is seen (n).

    Gradients change evenly from the `first` to the `last`. Where they turn from the light or to it, only what lies in
    front of that place is lit, or what lies behind it.
    """
    lamp, _ = _light_and_half(scene)
    front, back = (-(gradient @ lamp) for gradient in (first, last))
    turns = (front * back < 0) if not scene.shading.two_sided else torch.zeros_like(front, dtype=torch.bool)
    turn = (front / torch.where(turns, front - back, 1.0) - begin).clamp(min=0).minimum(width)
    start, end = torch.where(turns & (front <= 0), turn, 0.0), torch.where(turns & (front > 0), turn, width)
    before_start, before_end, whole = (-torch.expm1(-depth * part / width) for part in (start, end, width))
    share = torch.where(turns, (before_end - before_start) / whole.clamp(min=1e-300), 1.0)
    return begin + start + (end - start) * _middle_seen(depth * (end - start) / width), share


def _middle_seen(depth: Tensor) -> Tensor:
    """Where the middle of what is seen lies in even matter of an optical depth (n)."""
    return torch.where(
        depth < 1e-4, 0.5 - depth / 12, 1 / depth.clamp(min=1e-5) - 1 / torch.expm1(depth.clamp(min=1e-5))
    )


def _by_plane(scene: Scene, fields: dict[Field, Tensor], shares: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Depth (n), emitted and reflected colour (n, 3): of the row of entries of each pixel's strength."""
    table, strength = plane_table(scene.plane.patches), fields[Field.STRENGTH]
    depths = -torch.log1p(-table.opacity.clamp(max=MOST_OPAQUE))
    depth, *colours = (
        torch.einsum("nd,ndc->nc", shares, entries[strength])
        for entries in (depths[..., None], depths[..., None] * table.emit, depths[..., None] * table.refl)
    )
    emitted, reflected = (colour / depth.clamp(min=1e-300) for colour in colours)
    return depth[:, 0], emitted, reflected


def _depths(scene: Scene, fields: dict[Field, Tensor]) -> Tensor:
    """The optical depth of one reference spacing, for each density (n, 256)."""
    return -torch.log1p(-_opacity(scene, fields).clamp(max=MOST_OPAQUE))


@cache
def _entries(table: ColourTable | ScalarTable) -> Tensor:
    return torch.tensor(table.entries(), dtype=torch.float64)


def _opacity(scene: Scene, fields: dict[Field, Tensor] | None) -> Tensor:
    opacity = torch.ones(256, dtype=torch.float64)
    tables = [(scene.tables.opac, scene.cross_bar.opac)]
    if scene.shading.modulation:
        tables.append((scene.tables.modu, scene.cross_bar.modu))
    for table, field in tables:
        entries = _entries(table)
        if field == Field.DENSITY or entries.min() == entries.max():  # the same everywhere: density's as well
            opacity = opacity * entries
        elif fields is not None:
            opacity = opacity * entries[fields[field]][..., None]
    return opacity


def _colour(scene: Scene, table: str, fields: dict[Field, Tensor], shares: Tensor) -> Tensor:
    """(n, 3): of a table that density indexes the mean, by the depth that density alone gives."""
    entries = _entries(getattr(scene.tables, table))
    field = getattr(scene.cross_bar, table)
    if field != Field.DENSITY:
        return entries[fields[field]]
    depth = -torch.log1p(-_opacity(scene, None).clamp(max=MOST_OPAQUE))
    whole = (shares @ depth)[..., None]
    means = shares @ (depth[:, None] * entries) / whole.clamp(min=1e-300)
    return torch.where(whole < 1e-12, entries[fields[field]], means)


def _light_and_half(scene: Scene) -> tuple[Tensor, Tensor]:
    """Towards the light, and half-way from there to the viewer, along physical axes."""
    to_physical = matrices.transposed(screen_rotation(scene.view))
    light = matrices.normalised(scene.light.direction)
    if scene.light.fixed_to == "world":
        light = matrices.applied(to_physical, light)
    between = matrices.plus(light, matrices.applied(to_physical, (0.0, 0.0, 1.0)))
    half = matrices.normalised(between) if matrices.length(between) > OPPOSITE else (0.0, 0.0, 0.0)
    return torch.tensor(light, dtype=torch.float64), torch.tensor(half, dtype=torch.float64)


def _light(gradient: Tensor, scene: Scene) -> Tensor:
    """What multiplies the reflected colour (n)."""
    active = active_shading(scene, Step.G)
    size = torch.linalg.vector_norm(gradient, dim=-1)
    outward = -gradient / size.clamp(min=1e-300)[..., None]
    lambert, towards_half = (outward @ towards for towards in _light_and_half(scene))
    if scene.shading.two_sided:
        lambert, towards_half = lambert.abs(), towards_half.abs()
    specular = torch.where(lambert > 0, towards_half.clamp(min=0) ** scene.shading.specular_power, 0.0)
    total = lambert.clamp(min=0) * float(active.diffuse) + specular * float(active.specular)
    return torch.where(size < 1e-9, 0.0, total)


def _dimming(gradient: Tensor, place: Tensor, scene: Scene, plan: FramePlan) -> Tensor:
    """What is left of all colour (H, W): far away, and where a surface turns away from the viewer."""
    z = plan.screen_index[2]
    nearness = (z.origin + place @ (2 * torch.tensor(z.half_steps, dtype=torch.float64))) / 2**FRACTION_BITS / 256
    cue = 1 - scene.light.depth_cue * (1 - nearness.clamp(0, 1))
    eye = torch.tensor(
        matrices.applied(matrices.transposed(screen_rotation(scene.view)), (0.0, 0.0, 1.0)), dtype=torch.float64
    )
    size = torch.linalg.vector_norm(gradient, dim=-1)
    facing = (gradient @ eye).abs() / size.clamp(min=1e-300)
    edge = torch.where(size < 1e-9, 0.0, (1 - facing.clamp(max=1)) ** 2)
    left: Tensor = cue * (1 - scene.light.silhouettes * edge)
    return left
