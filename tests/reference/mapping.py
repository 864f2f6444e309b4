"""Grid to screen mapping (paper: "Screen Mapping"): which samples a frame visits, and where they lie.

Exact positions follow the view's definition in real numbers (design, section 5) and know nothing of the DDA.
"""

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import torch
from torch import Tensor

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import FramePlan, Reach
from volsplat.protocol.rules.grid_on_screen import Dda
from volsplat.protocol.rules.packet_layout import SUBPIXEL_BITS
from volsplat.protocol.rules.resolved_view import resolved_center, resolved_zoom

GOLDEN = round(2**32 * (math.sqrt(5) - 1) / 2)
QUARTER = math.sqrt(0.5)
# The turns that bring each axis to z, as quaternions (x, y, z, w).
UPRIGHT = {
    "auto": (0.0, 0.0, 0.0, 1.0),
    "+z": (0.0, 0.0, 0.0, 1.0),
    "-z": (0.0, 1.0, 0.0, 0.0),
    "+y": (QUARTER, 0.0, 0.0, QUARTER),
    "-y": (-QUARTER, 0.0, 0.0, QUARTER),
    "+x": (0.0, -QUARTER, 0.0, QUARTER),
    "-x": (0.0, QUARTER, 0.0, QUARTER),
}


@dataclass(frozen=True)
class Samples:
    """The visited samples of a frame in traversal order; n of them, all tensors on the CPU."""

    indices: Tensor  # (n, 3) int64, grid i, j, k
    ordinals: Tensor  # (n, 3) int64, sheet, row, sample
    blocks: Tensor  # (n, 3, 2) int64, the half-open range of voxels each stands for, on i, j, k
    lattice: Tensor  # (n, 2) int64, the plan's x and y in 1/64 pixel, as on the wire
    exact: Tensor  # (n, 2) float64, the same positions in pixels, not quantised
    thresholds: Tensor  # (n,) int64, by which lattice and footprint offsets are rounded

    def chosen(self, which: Tensor | slice) -> "Samples":
        return Samples(*(getattr(self, field.name)[which] for field in fields(self)))

    @property
    def block_sizes(self) -> Tensor:
        """(n, 3) int64: voxels along i, j and k."""
        return self.blocks[..., 1] - self.blocks[..., 0]


def rotated(quaternion: tuple[float, float, float, float], vectors: Tensor) -> Tensor:
    """q v q* for `vectors` (..., 3) and a quaternion (x, y, z, w) of any length."""
    q = torch.tensor(quaternion, dtype=torch.float64)
    q = q / torch.linalg.vector_norm(q)
    axis = q[:3].expand_as(vectors)
    turned: Tensor = 2 * torch.linalg.cross(axis, vectors)
    result: Tensor = vectors + q[3] * turned + torch.linalg.cross(axis, turned)
    return result


@lru_cache(8)  # one frame asks many times
def steps_on_screen(scene: Scene, geometry: Geometry) -> Tensor:
    """(3, 3) float64: the columns are a step of i, j and k in pixels, x right, y UP, z to the viewer."""
    matrix = torch.tensor(geometry.index_to_physical, dtype=torch.float64)
    reference_spacing = torch.linalg.det(matrix).abs() ** (1 / 3)
    pixels_per_unit = resolved_zoom(scene, geometry) / reference_spacing
    steps: Tensor = rotated(scene.view.rotation, rotated(UPRIGHT[scene.view.up], matrix.T)) * pixels_per_unit
    return steps.T


def on_screen(points: Tensor, scene: Scene, geometry: Geometry) -> Tensor:
    """Pixel positions (n, 2), x right and y down from the top-left pixel's centre, of grid points (n, 3)."""
    center = torch.tensor(resolved_center(scene, geometry), dtype=torch.float64)
    screen = (points - center) @ steps_on_screen(scene, geometry).T
    return torch.stack(
        ((scene.image.width - 1) / 2 + screen[:, 0], (scene.image.height - 1) / 2 - screen[:, 1]),
        dim=1,
    )


def thresholds(plan: FramePlan, indices: Tensor) -> Tensor:
    """(n,) of samples at grid indices (n, 3): 2^31 + 2^25, and with footprints the golden ratio for each sheet.

    0, that is down, where one pixel holds all of a sample.
    """
    if plan.reach == Reach.PIXEL:
        return torch.zeros(len(indices), dtype=torch.int64)
    sheets = indices[:, plan.traversal.axes[0]] if plan.footprint else torch.zeros(len(indices)).long()
    return (sheets * GOLDEN + (1 << 31) + (1 << 25)) % (1 << 32)


def on_lattice(dda: Dda, doubled: Tensor, threshold: Tensor) -> Tensor:
    """The DDA's positions (n,) of doubled grid indices (n, 3), rounded to 1/64 pixel by their sheets' `threshold`."""
    value = dda.origin + (doubled * torch.tensor(dda.half_steps, dtype=torch.int64)).sum(dim=1)
    unit = 1 << (32 - SUBPIXEL_BITS)
    return (value + threshold % unit) // unit


def samples_of(scene: Scene, geometry: Geometry, plan: FramePlan) -> Samples:
    """All visited samples in the nested-loop order of the plan's traversal."""
    indices_on, blocks_on = [], []
    for visits in plan.visits:
        indices_on.append(torch.tensor([visits.index(n) for n in range(visits.count)]))
        blocks_on.append(torch.tensor([visits.block(n) for n in range(visits.count)]))
    traversal = plan.traversal
    counts = [plan.visits[axis].count for axis in traversal.axes]
    ordinals = torch.cartesian_prod(*(torch.arange(count) for count in counts)).reshape(-1, 3)
    indices = torch.empty_like(ordinals)
    blocks = torch.empty((len(ordinals), 3, 2), dtype=torch.int64)
    for loop, axis in enumerate(traversal.axes):
        visit = ordinals[:, loop] if traversal.ascending[loop] else counts[loop] - 1 - ordinals[:, loop]
        indices[:, axis] = indices_on[axis][visit]
        blocks[:, axis] = blocks_on[axis][visit]
    doubled = blocks[..., 0] + blocks[..., 1] - 1
    exact = on_screen(doubled.double() / 2, scene, geometry)
    threshold = thresholds(plan, indices)
    return Samples(
        indices=indices,
        ordinals=ordinals,
        blocks=blocks,
        lattice=torch.stack([on_lattice(dda, doubled, threshold) for dda in (plan.x, plan.y)], dim=1),
        exact=exact.flip(1) if plan.turned else exact,
        thresholds=threshold,
    )
