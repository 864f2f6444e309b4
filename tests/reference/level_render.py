"""A picture of a coarser level in float64: the level as a volume of its own, with thicker and with partial voxels."""

import math

import msgspec
import torch
from torch import Tensor

from reference import mapping, render, shading, voxel_packets
from reference.footprint import footprint_of
from volsplat.protocol.description.scene import Bounds, Scene, Step
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation

LEAST_PEAK = 2.4
TERMS = 4000


def render_level(
    packets: Tensor, geometry: Geometry, level: Geometry, quantisation: Quantisation, scene: Scene, partial: bool = True
) -> Tensor:
    """Step F of a level whose voxels are 2^n of the volume's on each axis, at a pixel a voxel of the volume or more.

    `geometry` is the volume's. The scene has a centre and bounds in numbers. Not `partial`: voxels that reach beyond
    the bounds are as opaque as others.
    """
    factor = round(level.spacing[0] / geometry.spacing[0])
    assert isinstance(scene.view.zoom, float) and scene.view.zoom >= 1.0 and not isinstance(scene.view.center, str)
    middle = [(at + 0.5) / factor - 0.5 for at in scene.view.center]
    low, high = scene.bounds.low, scene.bounds.high
    i, j, k = (n // factor for n in low)
    last_i, last_j, last_k = (-(-n // factor) for n in high)
    own = msgspec.structs.replace(
        scene,
        view=msgspec.structs.replace(scene.view, zoom=scene.view.zoom * factor, center=tuple(middle)),
        bounds=Bounds(low=(i, j, k), high=(last_i, last_j, last_k)),
    )
    plan = plan_frame(own, level, Step.F).upright
    gain = _gain(factor)
    samples = mapping.samples_of(own, level, plan)
    begin = samples.indices * factor
    inside = torch.minimum(begin + factor, torch.tensor(high)) - torch.maximum(begin, torch.tensor(low))
    share = (inside / factor).prod(dim=1) if partial else torch.ones(len(begin))
    at_i, at_j, at_k = samples.indices.unbind(1)
    here = packets[at_k, at_j, at_i]
    fields = shading.field_bytes(plan, level, "rough", samples.indices, here)
    directions = voxel_packets.directions("rough")
    colour, opacity = shading.shade(here, fields, own, Step.F, factor / gain * share.double(), directions)
    shaded = render.Shaded(samples, colour, opacity)
    footprint = footprint_of(mapping.steps_on_screen(own, level), scene.view.zoom * factor, 1, scene.reconstruction)
    buffer = torch.zeros((plan.height * plan.width, 4), dtype=torch.float64)

    def weights(chosen: mapping.Samples, pixel_x: Tensor, pixel_y: Tensor) -> Tensor:
        x, y = (chosen.lattice.double() / render.LATTICE).unbind(1)
        return gain * footprint.weights((pixel_x - x[:, None])[:, None, :], (pixel_y - y[:, None])[:, :, None])

    render._splat_footprints(buffer, shaded, plan, own, footprint, render.AS_ON_THE_WIRE, weights)
    return buffer.reshape(plan.height, plan.width, 4)


def _gain(factor: int) -> float:
    """2.4 u with Li2(u) = f Li2(1 / 2.4), as footprints of both have the amplitude 1."""
    through = factor * _dilogarithm(1 / LEAST_PEAK)
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if _dilogarithm(middle) < through else (low, middle)
    return max(LEAST_PEAK * low, 1.0)


def _dilogarithm(x: float) -> float:
    return math.fsum(x**n / n**2 for n in range(1, TERMS))
