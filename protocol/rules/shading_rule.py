"""How the samples of a frame become colour and opacity (paper: "Shading"), with what its step leaves of the scene."""

import msgspec

from volsplat.protocol.description.patches import NO_COLOUR, Patches
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Light, Scene, Shading
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.refinement import STEP_RULES, active_shading
from volsplat.protocol.rules.resolved_view import screen_rotation

BLACK = ColourTable(points=((0.0, NO_COLOUR),))
ONE = ScalarTable(points=((0.0, 1.0),))

LONGEST_UNIT = 1.0 + 1e-9  # rounding included


class Lighting(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What multiplies the reflected colour; unit vectors along the volume's physical axes.

    In frames of slabs also what multiplies all colour (see slab_shape); in others that is 0.
    """

    light: Vector  # towards it
    half_way: Vector  # between light and eye, or zero where they are opposite: then nothing is reflected to the eye
    diffuse: bool
    specular: bool
    two_sided: bool
    specular_power: float
    depth_cue: float = 0.0
    silhouettes: float = 0.0

    def __post_init__(self) -> None:
        if not all(matrices.length(vector) <= LONGEST_UNIT for vector in (self.light, self.half_way)):
            raise ValueError(f"light and half way must be unit vectors, not {self.light} and {self.half_way}")
        Shading(specular_power=self.specular_power)
        Light(depth_cue=self.depth_cue, silhouettes=self.silhouettes)


class ShadingRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The four tables, what indexes them, and the light: what is off is black, without modulation modu is 1.

    Patches over density and strength take the tables' place.
    """

    emit: ColourTable
    refl: ColourTable
    opac: ScalarTable
    modu: ScalarTable
    cross_bar: CrossBar
    lighting: Lighting
    patches: Patches = ()


OPPOSITE = 1e-9  # the length of a sum of two unit vectors, below which it is rounding


def shading_rule(scene: Scene, step: Step) -> ShadingRule:
    active, tables, cross_bar = active_shading(scene, step), scene.tables, scene.cross_bar
    if scene.plane.patches:
        return ShadingRule(
            emit=BLACK,
            refl=BLACK,
            opac=ONE,
            modu=ONE,
            cross_bar=CrossBar(),
            lighting=_lighting(scene, step),
            patches=scene.plane.patches if active.emitted else _without_emission(scene.plane.patches),
        )
    modulated = scene.shading.modulation
    return ShadingRule(
        emit=tables.emit if active.emitted else BLACK,
        refl=tables.refl,
        opac=tables.opac,
        modu=tables.modu if modulated else ONE,
        cross_bar=cross_bar if modulated else msgspec.structs.replace(cross_bar, modu=Field.STRENGTH),
        lighting=_lighting(scene, step),
    )


def _without_emission(patches: Patches) -> Patches:
    return tuple(msgspec.structs.replace(patch, emit=NO_COLOUR) for patch in patches)


def _lighting(scene: Scene, step: Step) -> Lighting:
    active = active_shading(scene, step)
    to_physical = matrices.transposed(screen_rotation(scene.view))
    light = matrices.normalised(scene.light.direction)
    if scene.light.fixed_to == "world":
        light = matrices.applied(to_physical, light)
    eye = matrices.applied(to_physical, (0.0, 0.0, 1.0))
    between = matrices.plus(light, eye)
    in_slabs = STEP_RULES[step].slabs
    return Lighting(
        light=light,
        half_way=matrices.normalised(between) if matrices.length(between) > OPPOSITE else (0.0, 0.0, 0.0),
        diffuse=active.diffuse,
        specular=active.specular,
        two_sided=scene.shading.two_sided,
        specular_power=scene.shading.specular_power,
        depth_cue=scene.light.depth_cue if in_slabs else 0.0,
        silhouettes=scene.light.silhouettes if in_slabs else 0.0,
    )
