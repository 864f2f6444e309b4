"""A picture of a coarser level in float64: the level as a volume of its own, with thicker and with partial voxels."""

import math

import msgspec
import torch
from torch import Tensor

from reference import mapping, render, shading, voxel_packets
from reference.footprint import footprint_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation

LEAST_PEAK = 2.4
TERMS = 4000


def render_level(
    packets: Tensor, geometry: Geometry, level: Geometry, quantisation: Quantisation, scene: Scene, partial: bool = True
) -> Tensor:
    """Step F of a level each of whose voxels is made of some of the volume's, as many on each axis.

    `geometry` is the volume's. The scene has a centre and bounds in numbers. Not `partial`: voxels that reach beyond
    the bounds are as opaque as others.
    """
    factors = [round(coarse / fine) for coarse, fine in zip(level.spacing, geometry.spacing, strict=True)]
    thickness = math.prod(factors) ** (1 / 3)
    assert isinstance(scene.view.zoom, float) and not isinstance(scene.view.center, str)
    middle = [(at + 0.5) / factor - 0.5 for at, factor in zip(scene.view.center, factors, strict=True)]
    low, high = scene.bounds.low, scene.bounds.high
    i, j, k = (n // factor for n, factor in zip(low, factors, strict=True))
    last_i, last_j, last_k = (-(-n // factor) for n, factor in zip(high, factors, strict=True))
    own = msgspec.structs.replace(
        scene,
        view=msgspec.structs.replace(scene.view, zoom=scene.view.zoom * thickness, center=tuple(middle)),
        bounds=Bounds(low=(i, j, k), high=(last_i, last_j, last_k)),
    )
    plan = plan_frame(own, level, Step.F).upright
    footprint = footprint_of(mapping.steps_on_screen(own, level), scene.view.zoom * thickness, 1, scene.reconstruction)
    of_volume = footprint_of(mapping.steps_on_screen(scene, geometry), scene.view.zoom, 1, scene.reconstruction)
    gain = _gain(thickness, footprint.amplitude, of_volume.amplitude)
    samples = mapping.samples_of(own, level, plan)
    on_axes = torch.tensor(factors)
    begin = samples.indices * on_axes
    inside = torch.minimum(begin + on_axes, torch.tensor(high)) - torch.maximum(begin, torch.tensor(low))
    share = (inside / on_axes).prod(dim=1) if partial else torch.ones(len(begin))
    at_i, at_j, at_k = samples.indices.unbind(1)
    here = packets[at_k, at_j, at_i]
    fields = shading.field_bytes(plan, level, "rough", samples.indices, here)
    directions = voxel_packets.directions("rough")
    colour, opacity = shading.shade(here, fields, own, Step.F, thickness / gain * share.double(), directions)
    shaded = render.Shaded(samples, colour, opacity)
    buffer = torch.zeros((plan.height * plan.width, 4), dtype=torch.float64)

    def weights(chosen: mapping.Samples, pixel_x: Tensor, pixel_y: Tensor) -> Tensor:
        x, y = (chosen.lattice.double() / render.LATTICE).unbind(1)
        return gain * footprint.weights((pixel_x - x[:, None])[:, None, :], (pixel_y - y[:, None])[:, :, None])

    render._splat_footprints(buffer, shaded, plan, own, footprint, render.AS_ON_THE_WIRE, weights)
    return buffer.reshape(plan.height, plan.width, 4)


def _gain(thickness: float, amplitude: float, of_volume: float) -> float:
    """2.4 u / A with Li2(u) = f (A / B) Li2(B / 2.4), A and B being the amplitudes of the level and the volume."""
    through = thickness * amplitude / of_volume * _dilogarithm(min(of_volume / LEAST_PEAK, 1.0))
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if _dilogarithm(middle) < through else (low, middle)
    return max(LEAST_PEAK * low / amplitude, 1.0)


def _dilogarithm(x: float) -> float:
    return math.fsum(x**n / n**2 for n in range(1, TERMS))
