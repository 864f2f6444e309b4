"""The tables that a scene is shaded through, kept from frame to frame while what they are made of stays the same."""

from functools import lru_cache

from volsplat.mapshade_server import _kernels
from volsplat.protocol import matrices
from volsplat.protocol.frame_plan import FramePlan
from volsplat.protocol.matrices import Matrix, Vector
from volsplat.protocol.refinement import active_shading
from volsplat.protocol.scene import TABLE_ENTRIES, Colour, ColourTable, ScalarTable, Scene, Step

# The blocks of A and B come in up to 27 sizes, and a scene is turned through A to F again and again.
KEPT_OPACITY_TABLES = 96  # of 128 KiB
KEPT_LIGHT_TABLES = 8
KEPT_TABLES = 16

BLACK = ((0.0, 0.0, 0.0),) * TABLE_ENTRIES
ONES = (1.0,) * TABLE_ENTRIES


@lru_cache(KEPT_TABLES)
def colour_entries(table: ColourTable) -> tuple[Colour, ...]:
    return tuple(table.entries())


@lru_cache(KEPT_TABLES)
def scalar_entries(table: ScalarTable) -> tuple[float, ...]:
    return tuple(table.entries())


def opacity_codes(scene: Scene, exponent: float) -> "_kernels.Array":
    """12-bit codes at opac index | modu index << 8, uint16 (65536,), of samples of this opacity exponent."""
    modu = scalar_entries(scene.tables.modu) if scene.shading.modulation else ONES
    return _opacity_codes(scalar_entries(scene.tables.opac), modu, exponent)


@lru_cache(KEPT_OPACITY_TABLES)
def _opacity_codes(opac: tuple[float, ...], modu: tuple[float, ...], exponent: float) -> "_kernels.Array":
    return _kernels.opacity_table(opac, modu, exponent)


def light_of_directions(scene: Scene, step: Step, plan: FramePlan, octahedral: bool) -> "_kernels.Array":
    """What multiplies the reflected colour, by direction code: float32 (32768,)."""
    active = active_shading(scene, step)
    to_physical = matrices.transposed(plan.rotation)
    light = matrices.normalised(scene.light.direction)
    if scene.light.fixed_to == "world":
        light = matrices.applied(to_physical, light)
    eye = matrices.applied(to_physical, (0.0, 0.0, 1.0))
    return _light_table(
        octahedral,
        light,
        _half_way(light, eye),
        active.diffuse,
        active.specular,
        scene.shading.two_sided,
        scene.shading.specular_power,
    )


@lru_cache(KEPT_LIGHT_TABLES)
def _light_table(
    octahedral: bool, light: Vector, half: Vector, diffuse: bool, specular: bool, two_sided: bool, power: float
) -> "_kernels.Array":
    return _kernels.light_table(octahedral, light, half, diffuse, specular, two_sided, power)


def _half_way(light: Vector, eye: Vector) -> Vector:
    """The unit vector between two, or zero where they are opposite: then nothing is reflected to the eye."""
    between = matrices.plus(light, eye)
    return matrices.normalised(between) if any(between) else between


@lru_cache(KEPT_TABLES)
def gradient_bytes(octahedral: bool, index_to_physical: Matrix) -> "_kernels.Array":
    """The bytes of the fields gradient i, j, k by direction code: uint8 (3, 32768)."""
    axes = [matrices.normalised(matrices.column(index_to_physical, axis)) for axis in range(3)]
    return _kernels.gradient_bytes(octahedral, axes)
