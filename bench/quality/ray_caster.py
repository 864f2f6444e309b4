"""A ray caster in plain float64, to judge pictures by: what a scene means, with no voxel packets, kernels or slabs.

A ray passes through the middle of each pixel, with so many samples on it that more change nothing. Tables are straight
lines between their entries, looked up by the density itself; opacity is that of the piece of ray between two samples.
It knows scenes whose tables are looked up by density, without modulation.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

from volsplat.bench.quality.density_fields import DensityField
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, CrossBar
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.resolved_view import resolved_center, resolved_zoom, screen_rotation

LAST = TABLE_ENTRIES - 1
FAINTEST = 1e-4  # of the light: where less comes through, what lies behind is left out
CHUNK = 1 << 15  # rays at a time
NO_GRADIENT = 1e-12


@contextmanager
def one_thread() -> Iterator[None]:
    """Torch's threads wait for each other many times as long on busy cores."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@dataclass(frozen=True)
class Rays:
    """One for each pixel, line by line: where it is level with the image's centre, and how it goes on."""

    start: Tensor  # (pixels, 3) grid coordinates
    step: Tensor  # (3,) of one reference spacing away from the viewer
    low: Tensor  # (3,): the corners of the outermost voxels' cells
    high: Tensor
    first: float  # depth, in reference spacings from the image's centre, at which the first enters the volume
    last: float

    def at(self, rays: Tensor, depth: Tensor | float) -> Tensor:
        """(n, 3) for the numbers of rays (n,) and depths in reference spacings."""
        return self.start[rays] + torch.as_tensor(depth, dtype=torch.float64)[..., None] * self.step

    def inside(self, places: Tensor, margin: float = 0.0) -> Tensor:
        return ((places >= self.low - margin) & (places <= self.high + margin)).all(dim=-1)


class Tables:
    """The scene's tables over densities in the data's units."""

    def __init__(self, scene: Scene, window: tuple[float, float]) -> None:
        self._low, self._scale = window[0], LAST / (window[1] - window[0])
        self._opac = torch.tensor(scene.tables.opac.entries(), dtype=torch.float64)
        self.emit, self.refl = (
            torch.tensor(table.entries(), dtype=torch.float64) for table in (scene.tables.emit, scene.tables.refl)
        )
        self.emits = scene.shading.emitted
        self._visible_before = torch.cat((torch.zeros(1), (self._opac > 0).double())).cumsum(0)

    def at(self, table: Tensor, density: Tensor) -> Tensor:
        place = self._place(density)
        first = place.floor().long().clamp(max=LAST - 1)
        share = (place - first).reshape(-1, *[1] * (table.dim() - 1))
        return table[first] * (1 - share) + table[first + 1] * share

    def opacity(self, density: Tensor) -> Tensor:
        """For one reference spacing."""
        return self.at(self._opac, density)

    def may_show(self, bounds: tuple[Tensor, Tensor]) -> Tensor:
        """Whether a density between these could be seen."""
        low, high = self._place(bounds[0]).floor().long(), self._place(bounds[1]).ceil().long()
        return self._visible_before[high + 1] > self._visible_before[low]

    def _place(self, density: Tensor) -> Tensor:
        return ((density - self._low) * self._scale).clamp(0, LAST)


def cast(field: DensityField, geometry: Geometry, scene: Scene, window: tuple[float, float], distance: float) -> Tensor:
    """The image (H, W, 4) float64, associated alpha; a sample at least every `distance` voxels of a ray."""
    with one_thread():
        return _cast(field, geometry, scene, window, distance)


def _cast(
    field: DensityField, geometry: Geometry, scene: Scene, window: tuple[float, float], distance: float
) -> Tensor:
    assert scene.cross_bar == CrossBar() and not scene.shading.modulation, "tables by density, nothing modulated"
    rays, tables = rays_of(scene, geometry), Tables(scene, window)
    light = light_of(scene, geometry)
    width = min(geometry.spacing) / geometry.reference_spacing  # of a piece: half of it is half a voxel at most
    samples = -(-width // distance)
    image = torch.zeros((len(rays.start), 4), dtype=torch.float64)
    for n in range(int((rays.last - rays.first) // width) + 1):
        middle = rays.first + (n + 0.5) * width
        depths = [middle + ((m + 0.5) / samples - 0.5) * width for m in range(int(samples))]
        active = _active(image, rays, field, tables, middle)
        for part in (active[low : low + CHUNK] for low in range(0, len(active), CHUNK)):
            image[part] = _through(image[part], part, depths, width / samples, field, rays, tables, light)
    return image.reshape(scene.image.height, scene.image.width, 4)


def rays_of(scene: Scene, geometry: Geometry) -> Rays:
    height, width = scene.image.height, scene.image.width
    y, x = torch.meshgrid(torch.arange(height).double(), torch.arange(width).double(), indexing="ij")
    right, up = x - (width - 1) / 2, (height - 1) / 2 - y
    zoom = resolved_zoom(scene, geometry)
    to_screen = matrices.times(
        matrices.product(screen_rotation(scene.view), geometry.index_to_physical), zoom / geometry.reference_spacing
    )
    to_grid = torch.tensor(matrices.inverse(to_screen), dtype=torch.float64)
    off = torch.stack((right, up, torch.zeros_like(up)), dim=-1).reshape(-1, 3) @ to_grid.T
    center = torch.tensor(resolved_center(scene, geometry), dtype=torch.float64)
    low = torch.full((3,), -0.5, dtype=torch.float64)
    high = low + torch.tensor(geometry.dims)
    corners = torch.cartesian_prod(*torch.stack((low, high)).T)
    depths = -(corners - center) @ torch.tensor(to_screen[2], dtype=torch.float64) / zoom
    return Rays(center + off, -zoom * to_grid[:, 2], low, high, float(depths.min()), float(depths.max()))


def light_of(scene: Scene, geometry: Geometry) -> Callable[[Tensor], Tensor]:
    """What multiplies the reflected colour (n,), for gradients per index step (n, 3)."""
    to_physical = matrices.transposed(screen_rotation(scene.view))
    light = matrices.normalised(scene.light.direction)
    if scene.light.fixed_to == "world":
        light = matrices.applied(to_physical, light)
    half = matrices.normalised(matrices.plus(light, matrices.applied(to_physical, (0.0, 0.0, 1.0))))
    towards = torch.tensor((light, half), dtype=torch.float64)
    steps_to_lengths = torch.tensor(matrices.inverse(geometry.index_to_physical), dtype=torch.float64)
    shading = scene.shading

    def lit(gradient: Tensor) -> Tensor:
        physical = gradient @ steps_to_lengths
        size = torch.linalg.vector_norm(physical, dim=-1)
        cosines = -(physical / size.clamp(min=NO_GRADIENT)[:, None]) @ towards.T
        if shading.two_sided:
            cosines = cosines.abs()
        diffuse, highlight = cosines.clamp(min=0).unbind(-1)
        specular = torch.where(diffuse > 0, highlight**shading.specular_power, 0.0)
        total = diffuse * float(shading.diffuse) + specular * float(shading.specular)
        return torch.where(size < NO_GRADIENT, 0.0, total)

    return lit


def _active(image: Tensor, rays: Rays, field: DensityField, tables: Tables, middle: float) -> Tensor:
    """The numbers of the rays that may meet something that shows in the piece around this depth."""
    open_rays = torch.nonzero(1 - image[:, 3] > FAINTEST)[:, 0]
    places = rays.at(open_rays, middle)
    near = rays.inside(places, margin=0.5)
    open_rays, places = open_rays[near], places[near]
    return open_rays[tables.may_show(field.bounds(places))] if len(places) else open_rays


def _through(
    image: Tensor,
    active: Tensor,
    depths: list[float],
    length: float,
    field: DensityField,
    rays: Rays,
    tables: Tables,
    light: Callable[[Tensor], Tensor],
) -> Tensor:
    """The pixels of active rays (n, 4) after the samples at these depths, each of which stands for so much length."""
    places = torch.stack([rays.at(active, depth) for depth in depths])  # (samples, n, 3)
    density = field.density(places.reshape(-1, 3)).reshape(places.shape[:2])
    opacity = -torch.expm1(length * torch.log1p(-tables.opacity(density.flatten()).reshape(density.shape)))
    opacity = torch.where(rays.inside(places), opacity, 0.0)
    seen = opacity > 0
    colour = torch.zeros((*density.shape, 4), dtype=torch.float64)
    reflected = tables.at(tables.refl, density[seen]) * light(field.gradient(places[seen]))[:, None]
    shown = (tables.at(tables.emit, density[seen]) * float(tables.emits) + reflected).clamp(0, 1)
    colour[seen] = torch.cat((shown, torch.ones_like(shown[:, :1])), dim=-1)
    for sample in range(len(depths)):
        image = image + ((1 - image[:, 3]) * opacity[sample])[:, None] * colour[sample]
    return image
