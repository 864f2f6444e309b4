"""Scenes that every contender and the ray caster can show alike: tables by density, grey or of one tint, lit."""

from volsplat.bench.tables.scene_tables import SPECULAR_POWER
from volsplat.client.scene.table_makers import KEY_LIGHT, scalars
from volsplat.protocol.description.scene import Quantise, Scene, Shading
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.view_rotation import Quaternion, rotation_from_angles

EMITTED, REFLECTED = 0.12, 0.5
WHOLE_RANGE = Quantise(window=(0.0, 1.0))

SURFACE_VALUE, SURFACE_HALF_WIDTH, SURFACE_OPACITY = 0.5, 0.05, 0.95
SIGNAL_ANGLES = (15.0, 70.0)  # from above, a little from the side
SIGNAL_SIDE = 18.0  # voxels across the image, all of it surface: no background makes pictures alike

BALL_OPAC = scalars((0.1, 0.0), (0.6, 0.3), (1.0, 0.3))


def grey_scene(opac: ScalarTable, quantise: Quantise) -> Scene:
    emit, refl = (ColourTable(points=((0.0, (share, share, share)),)) for share in (EMITTED, REFLECTED))
    return Scene(
        tables=Tables(emit=emit, refl=refl, opac=opac),
        shading=Shading(modulation=False, specular_power=SPECULAR_POWER),
        light=KEY_LIGHT,
        quantise=quantise,
    )


def signal_scene() -> Scene:
    """The Marschner-Lobb signal as a thin surface where it is 0.5."""
    low, high = SURFACE_VALUE - SURFACE_HALF_WIDTH, SURFACE_VALUE + SURFACE_HALF_WIDTH
    return grey_scene(scalars((low, 0.0), (SURFACE_VALUE, SURFACE_OPACITY), (high, 0.0)), WHOLE_RANGE)


def ball_scene() -> Scene:
    """A soft solid ball."""
    return grey_scene(BALL_OPAC, WHOLE_RANGE)


def viewed(scene: Scene, rotation: Quaternion, zoom: float, size: tuple[int, int]) -> Scene:
    return scene.with_(rotation=rotation, zoom=zoom, size=size)


def signal_view(zoom: float) -> Scene:
    side = round(SIGNAL_SIDE * zoom)
    return viewed(signal_scene(), rotation_from_angles(*SIGNAL_ANGLES), zoom, (side, side))
