"""What light comes through a volume to a place in it, in plain float64 (protocol/rules/light_blocks.py)."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from reference import shading
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT
from volsplat.protocol.rules.resolved_view import resolved_bounds, screen_rotation

MOST_BLOCKS = 64
GOLDEN = (1 + math.sqrt(5)) / 2


@dataclass(frozen=True)
class BlockLight:
    """Of the scene's light, and of the sky: the share that comes to the middle of each block (k, j, i)."""

    lamp: Tensor
    sky: Tensor
    size: Tensor  # voxels of a block along i, j, k
    to_blocks: Tensor  # from physical vectors

    def at(self, place: Tensor, gradient: Tensor) -> tuple[Tensor, Tensor]:
        """Of both (H, W), at grid coordinates (H, W, 3), a block outwards from a surface with this gradient."""
        outwards = -gradient @ self.to_blocks.T
        size = torch.linalg.vector_norm(outwards, dim=-1, keepdim=True)
        steep = torch.linalg.vector_norm(gradient, dim=-1, keepdim=True) >= 1e-9
        outwards = torch.where(steep, outwards / size.clamp(min=1e-300), 0.0)
        block = (place + 0.5) / self.size - 0.5 + outwards
        return self._between(self.lamp, block), self._between(self.sky, block)

    @staticmethod
    def _between(shares: Tensor, block: Tensor) -> Tensor:
        last = torch.tensor(shares.shape[::-1]) - 1
        block = torch.minimum(block.clamp(min=0), last.double())
        low = block.floor().long()
        part = block - low
        found = torch.zeros(block.shape[:-1], dtype=torch.float64)
        for corner in torch.cartesian_prod(*(torch.arange(2),) * 3):
            i, j, k = torch.minimum(low + corner, last).unbind(dim=-1)
            found += torch.where(corner == 1, part, 1 - part).prod(dim=-1) * shares[k, j, i]
        return found


def block_light(packets: Tensor, geometry: Geometry, quantisation: Quantisation, scene: Scene) -> BlockLight:
    size = [-(-dim // MOST_BLOCKS) for dim in geometry.dims]
    depths = _depths(packets, geometry, quantisation, scene, size)
    inverse = torch.tensor(matrices.inverse(geometry.index_to_physical), dtype=torch.float64)
    to_blocks = inverse / torch.tensor(size, dtype=torch.float64)[:, None]
    light = torch.tensor(matrices.normalised(scene.light.direction), dtype=torch.float64)
    if scene.light.fixed_to == "world":
        light = torch.tensor(screen_rotation(scene.view), dtype=torch.float64).T @ light
    open_everywhere = torch.ones_like(depths)  # where the scene does not ask
    sky = [_passed(depths, to_blocks, way, geometry) for way in _sky()] if scene.light.occlusion else [open_everywhere]
    return BlockLight(
        lamp=_passed(depths, to_blocks, light, geometry) if scene.light.shadows else open_everywhere,
        sky=torch.stack(sky).mean(dim=0),
        size=torch.tensor(size, dtype=torch.float64),
        to_blocks=to_blocks,
    )


def _depths(packets: Tensor, geometry: Geometry, quantisation: Quantisation, scene: Scene, size: list[int]) -> Tensor:
    """Means over the voxels of each block, of one reference spacing."""
    k, j, i = torch.meshgrid(*map(torch.arange, packets.shape), indexing="ij")
    indices = torch.stack((i, j, k), dim=-1).reshape(-1, 3)
    opacity = _opacity(packets.flatten(), indices, geometry, quantisation, scene)
    bounds = resolved_bounds(scene, geometry)
    low, high = torch.tensor(bounds.low), torch.tensor(bounds.high)
    drawn = ((indices >= low) & (indices < high)).all(dim=1)
    depth = torch.where(drawn, -torch.log1p(-opacity.clamp(max=1 - 1 / 4096)), 0.0)
    block = indices // torch.tensor(size)
    shape = [-(-dim // of) for dim, of in zip(geometry.dims, size, strict=True)][::-1]
    at = (block[:, 2] * shape[1] + block[:, 1]) * shape[2] + block[:, 0]
    sums, counts = (torch.zeros(math.prod(shape), dtype=torch.float64) for _ in range(2))
    sums.index_add_(0, at, depth)
    counts.index_add_(0, at, torch.ones_like(depth))
    return (sums / counts).reshape(shape)


def _opacity(packets: Tensor, indices: Tensor, geometry: Geometry, quantisation: Quantisation, scene: Scene) -> Tensor:
    plan = plan_frame(scene, geometry, Step.F)
    fields = shading.field_bytes(plan, geometry, quantisation.directions, indices, packets)
    return torch.where(packets >> NO_DATA_BIT == 1, 0.0, shading.looked_up(fields, scene)[0])


def _sky() -> list[Tensor]:
    corners = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    for y in (-1 / GOLDEN, 1 / GOLDEN):
        for z in (-GOLDEN, GOLDEN):
            corners += [(0.0, y, z), (y, z, 0.0), (z, 0.0, y)]
    return [torch.tensor(corner, dtype=torch.float64) for corner in corners]


def _passed(depths: Tensor, to_blocks: Tensor, direction: Tensor, geometry: Geometry) -> Tensor:
    """From one direction, slice by slice."""
    step = to_blocks @ (direction / torch.linalg.vector_norm(direction))
    length = 1 / step.abs().max()
    through = torch.exp(-depths * length / geometry.reference_spacing)
    step = step * length
    along = int(step.abs().argmax())
    axes = [axis for axis in range(3) if axis != along]
    ordered = through.permute(2, 1, 0).movedim(along, 0)  # (slices, others in order)
    if step[along] > 0:
        ordered = ordered.flip(0)
    rows, columns = torch.meshgrid(*map(torch.arange, ordered.shape[1:]), indexing="ij")
    row, column = rows + step[axes[0]], columns + step[axes[1]]
    top, left = row.floor().long(), column.floor().long()
    down, right = row - top, column - left
    light, slices = torch.ones(ordered.shape[1:], dtype=torch.float64), []
    for dimmed in ordered:
        slices.append(light)
        padded = torch.nn.functional.pad((light * dimmed)[None], (3, 3, 3, 3), value=1.0)[0]
        light = torch.zeros_like(light)
        for below, beside in ((0, 0), (0, 1), (1, 0), (1, 1)):
            share = (down if below else 1 - down) * (right if beside else 1 - right)
            light = light + share * padded[top + below + 3, left + beside + 3]
    passed = torch.stack(slices)
    if step[along] > 0:
        passed = passed.flip(0)
    return passed.movedim(0, along).permute(2, 1, 0)
