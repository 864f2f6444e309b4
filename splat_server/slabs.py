"""What a frame of slabs is drawn by: the slices of its kernel, and how its densities are classified and lit."""

from functools import lru_cache
from typing import NamedTuple

from volsplat.protocol.description.patches import Patches
from volsplat.protocol.description.scene import Kernel, SlabKernel
from volsplat.protocol.description.shading_tables import Field
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.messages.frame_messages import RenderFrame
from volsplat.protocol.rules.footprint_shape import CORRECT_SPACING
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.light_blocks import DEPTH_UNIT, SKY, LightBlocks, light_step, to_blocks
from volsplat.protocol.rules.shading_rule import ShadingRule
from volsplat.protocol.rules.slab_kernels import COEFFICIENTS
from volsplat.protocol.text.errors import BadInput
from volsplat.splat_server import _kernels
from volsplat.splat_server.footprint_table import kernel_projection

FIELDS = list(Field)  # the kernel knows fields by their place here
# Below so many pixels a voxel, weights are too small for sums of 32 bits.
LEAST_NARROW_GAIN = 0.25
GREATEST_GRADIENT = 1e12  # of a difference between pixels or planes, per reference spacing


class Slabs(NamedTuple):
    kernel: _kernels.Slabs
    pixels_per_packet: int  # that are added to at most
    pixel_bytes: int  # that a pixel of a region takes while it is drawn


def slabs_of(request: RenderFrame) -> Slabs | None:
    """None where the frame is not one of slabs. Raises BadInput for kernels larger than any image."""
    drawing, plan, shading = request.drawing, request.drawing.plan, request.drawing.shading
    slabs = plan.slabs
    if slabs is None:
        return None
    geometry, ellipsoid = drawing.geometry, (slabs.amplitude, slabs.form, slabs.half_extents)
    table = slab_table(slabs.kernel, slabs.radius, *ellipsoid, slabs.offset_bits)
    axes = [matrices.normalised(matrices.column(geometry.index_to_physical, axis)) for axis in range(3)]
    dims, factors = geometry.dims, plan.factors
    kernel = _kernels.Slabs(
        table=table,
        scene=_scene(shading),
        grid=_kernels.SlabGrid(
            gradient=_gradient(slabs.gradient, geometry),
            axes=axes,
            strength=_strength_scale(drawing.quantisation) / geometry.reference_spacing,
            screen_bytes=[
                [dda.origin / FIXED_ONE, *(2 * step / FIXED_ONE for step in dda.half_steps)]
                for dda in plan.screen_index
            ],
            dims=dims,
            factors=factors,
        ),
        planes=slabs.planes,
        lead=slabs.lead,
        baseline=slabs.baseline,
        thickness=slabs.thickness,
        places=slabs.grid,
        bounds=(slabs.low, slabs.high),
        light=_light(request),
        **_passed(request),
        plane=_plane(shading.patches) if shading.patches else None,
    )
    slices = 2 * slabs.before + 2
    pixels_per_packet = slices * min(table.width, plan.width) * min(table.height, plan.height)
    return Slabs(kernel, pixels_per_packet, table.pixel_bytes)


@lru_cache(maxsize=2)
def slab_table(
    kernel: SlabKernel, radius: float, amplitude: float, form: Matrix, half_extents: Vector, offset_bits: int
) -> _kernels.SlabTable:
    """The table of a view. Raises BadInput where one kernel is larger than any image."""
    if kernel in COEFFICIENTS:
        projection = _kernels.KernelProjection.signed(COEFFICIENTS[kernel], radius)
    else:
        projection = kernel_projection(Kernel(kernel.value), radius)
    try:
        return _kernels.SlabTable(
            projection, amplitude, form, half_extents, offset_bits, wide=amplitude < LEAST_NARROW_GAIN
        )
    except ValueError as error:
        raise BadInput(f"{error}; lower the zoom, or {CORRECT_SPACING}") from error


def _gradient(per_unit: Matrix, geometry: Geometry) -> Matrix:
    """Per reference spacing: whatever unit of length the volume has, float32 holds its square.

    Raises BadInput where it does not.
    """
    per_spacing = matrices.times(per_unit, geometry.reference_spacing)
    if not all(abs(number) <= GREATEST_GRADIENT for row in per_spacing for number in row):
        raise BadInput(f"the gradients of a frame of slabs are too steep; {CORRECT_SPACING}")
    return per_spacing


def _light(request: RenderFrame) -> _kernels.SlabLight:
    blocks = request.light
    size = (1, 1, 1) if blocks is None else blocks.size
    shares = (0.0, 0.0) if blocks is None else (blocks.shadows, blocks.occlusion)
    to_grid = to_blocks(request.drawing.geometry, request.drawing.plan.factors, size)
    return _kernels.SlabLight(size=size, to_blocks=to_grid, shares=shares)


def _passed(request: RenderFrame) -> dict[str, _kernels.PassedLight | None]:
    """What light comes through, if it is dimmed at all."""
    if request.light is None:
        return {"lamp": None, "sky": None}
    drawing = request.drawing
    geometry, factors, light = drawing.geometry, drawing.plan.factors, drawing.shading.lighting.light
    return {
        "lamp": _passed_light(request.light, (light,), geometry, factors),
        "sky": _passed_light(request.light, SKY, geometry, factors),
    }


@lru_cache(maxsize=4)
def _passed_light(
    blocks: LightBlocks, directions: tuple[Vector, ...], geometry: Geometry, factors: Index
) -> _kernels.PassedLight:
    """The mean over directions along physical axes. Remembered, since the sky does not turn with the view."""
    steps = [light_step(direction, geometry, factors, blocks.size) for direction in directions]
    return _kernels.PassedLight(blocks.depths, DEPTH_UNIT, blocks.dims, [(step.step, step.length) for step in steps])


@lru_cache(maxsize=8)
def _scene(shading: ShadingRule) -> _kernels.SlabScene:
    cross_bar, lighting = shading.cross_bar, shading.lighting
    return _kernels.SlabScene(
        cross_bar=[FIELDS.index(field) for field in (cross_bar.emit, cross_bar.refl, cross_bar.opac, cross_bar.modu)],
        emit=shading.emit.entries(),
        refl=shading.refl.entries(),
        opac=shading.opac.entries(),
        modu=shading.modu.entries(),
        light=lighting.light,
        half_way=lighting.half_way,
        switches=(lighting.diffuse, lighting.specular, lighting.two_sided),
        specular_power=lighting.specular_power,
        dimming=(lighting.depth_cue, lighting.silhouettes),
    )


@lru_cache(maxsize=2)
def _plane(patches: Patches) -> _kernels.PatchTable:
    return _kernels.PatchTable([patch.numbers for patch in patches])


def _strength_scale(quantisation: Quantisation) -> float:
    """Bytes of strength per unit of a gradient of bytes of density."""
    return quantisation.strength_scale / quantisation.density_scale
