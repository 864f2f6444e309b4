"""What each key of a scene file means: the one list behind the written comments and the error messages."""

from typing import NamedTuple

from volsplat.protocol.description.scene import LARGEST_EXTENT, Field, Kernel, Order, Step
from volsplat.protocol.geometry.upright import UPS


class SceneKey(NamedTuple):
    allowed: str  # what may stand there, with its unit; also shown when a value is refused
    meaning: str


def _one_of(names: list[str]) -> str:
    return "one of " + ", ".join(f'"{name}"' for name in names)


_FIELDS = _one_of([field.value for field in Field])
_COLOUR = '"#rrggbb" or [r, g, b], each 0 to 1'
_COLOUR_POINTS = f"[[position, colour], ...], positions 0 to 1 in rising order, colours {_COLOUR}"
_SCALAR_POINTS = "[[position, value], ...], positions 0 to 1 in rising order, values 0 to 1"
_SWITCH = "true or false"

# Sections in the order of the file; "" is the top of the file.
SECTIONS: dict[str, str] = {
    "": "",
    "tables": "The four shading tables of 256 entries. A table is given by points that are joined by straight lines;\n"
    "position 0 is entry 0, position 1 is entry 255. Two points at one position make a step. Before the first and\n"
    "after the last point a table is constant. All colours are display-referred sRGB.",
    "tables.emit": "The colour that a sample gives off by itself.",
    "tables.refl": "The colour that a sample reflects: times L.G for diffuse, times H.G to a power for specular light.",
    "tables.opac": "The opacity of a sample for a thickness of one reference spacing.",
    "tables.modu": "A factor on that opacity: a ramp over gradient strength brings out surfaces, one over screen-z\n"
    "makes a depth cue.",
    "cross_bar": "Which field of a voxel indexes each table. Density is windowed (see quantise.window); strength is\n"
    "the gradient's length; gradient-i, -j, -k is its direction; screen-x runs right, screen-y up, screen-z towards\n"
    "the viewer, all three over the volume's bounding sphere; grid-i, -j, -k run over the whole volume.",
    "shading": "Switches for the parts of the shading rules. A part that is off counts as 0, modulation as 1.",
    "light": "One light, infinitely far away.",
    "view": "The orthographic view. Screen x runs right, y up, z towards the viewer.",
    "bounds": "The part of the grid that is drawn: low <= (i, j, k) < high.",
    "reconstruction": "The kernel that carries samples to the screen in the steps D to F.",
    "refine": "How the image refines through the steps A to F.",
    "image": "The picture.",
    "quantise": "How the volume's values become the 8 bits that index the tables. A change reads the volume anew.",
}

KEYS: dict[str, SceneKey] = {
    "order": SceneKey(
        _one_of([order.value for order in Order]),
        "Combine samples back to front, so that what is later hidden can be watched, or front to back.\n"
        "Fastest is front to back wherever something can be hidden.",
    ),
    "tables.emit.points": SceneKey(_COLOUR_POINTS, ""),
    "tables.refl.points": SceneKey(_COLOUR_POINTS, ""),
    "tables.opac.points": SceneKey(_SCALAR_POINTS, ""),
    "tables.modu.points": SceneKey(_SCALAR_POINTS, ""),
    "cross_bar.emit": SceneKey(_FIELDS, "The field that chooses the emitted colour."),
    "cross_bar.refl": SceneKey(_FIELDS, "The field that chooses the reflected colour."),
    "cross_bar.opac": SceneKey(_FIELDS, "The field that chooses the opacity."),
    "cross_bar.modu": SceneKey(_FIELDS, "The field that chooses the factor on the opacity."),
    "shading.emitted": SceneKey(_SWITCH, "Emitted light."),
    "shading.diffuse": SceneKey(_SWITCH, "Diffuse reflection."),
    "shading.specular": SceneKey(_SWITCH, "Specular reflection."),
    "shading.modulation": SceneKey(_SWITCH, "Modulation of the opacity."),
    "shading.specular_power": SceneKey(
        "above 0, at most 1000", "The n of the specular rule: a higher power gives smaller, sharper highlights."
    ),
    "shading.two_sided": SceneKey(_SWITCH, "Light surfaces from behind, too."),
    "light.direction": SceneKey(
        "[x, y, z], any length but zero", "From the volume towards the light, along the axes that fixed_to names."
    ),
    "light.fixed_to": SceneKey(
        '"world" or "grid"',
        "World: the light stays with the viewer, along screen axes. Grid: it turns with the volume's physical axes.",
    ),
    "view.rotation": SceneKey(
        "[x, y, z, w], a quaternion of any length but zero",
        "From upright axes (see up) to the screen's. [0, 0, 0, 1] looks from above, with the back up; the front is\n"
        "[-0.70710678, 0, 0, 0.70710678], the viewer at -y with z up.",
    ),
    "view.up": SceneKey(
        _one_of([*UPS, "auto"]),
        "The physical axis that stands upright, as z, before rotation; nothing is mirrored. Auto is what the file\n"
        "tells, or a guess by the end at which what is there tapers; `volsplat info` says which.",
    ),
    "view.zoom": SceneKey(
        '1/64 to 256 pixels per reference spacing, or "fit"',
        "The reference spacing is the cube root of a voxel's volume. Fit shows all that is visible under the tables\n"
        "and bounds, from whichever side: the smallest ball about it fills the image.",
    ),
    "view.center": SceneKey(
        '[i, j, k] in voxels, fractions allowed, or "middle"',
        "The grid point shown at the image's centre. Middle is that of the grid, or of what a fit shows.",
    ),
    "bounds.low": SceneKey("[i, j, k], whole voxels from 0", "The first voxel on each axis."),
    "bounds.high": SceneKey(
        "[i, j, k], whole voxels, above low; -1 means up to the end", "One past the last voxel on each axis."
    ),
    "reconstruction.kernel": SceneKey(_one_of([kernel.value for kernel in Kernel]), "The kernel's shape."),
    "reconstruction.radius": SceneKey(
        '1 to 4 voxels, or "default"', "Where the kernel is cut. A smaller one is faster, a larger one smoother."
    ),
    "refine.lit_from": SceneKey(
        _one_of([step.value for step in Step]),
        "The step at which diffuse light joins; specular joins one step later, at F, when this is E.",
    ),
    "refine.bare_buffer": SceneKey(
        _SWITCH, "Show a step's partial image alone, as in the paper, not over the finished step before it."
    ),
    "refine.striding": SceneKey(
        _SWITCH, "Of a prepared volume, A and B leave out voxels, as in the paper, instead of drawing means."
    ),
    "image.width": SceneKey(f"1 to {LARGEST_EXTENT} pixels", "The picture's width."),
    "image.height": SceneKey(f"1 to {LARGEST_EXTENT} pixels", "The picture's height."),
    "image.background": SceneKey(
        _COLOUR, "Lies under the picture in PNG, JPEG, TIFF and the page; EXR keeps its transparency instead."
    ),
    "image.edges": SceneKey(_SWITCH, "Draw the volume's boundary as white edges."),
    "quantise.window": SceneKey(
        '[low, high] in the volume\'s own units, or "auto"',
        "These values become density 0 and 255. Auto keeps 8-bit data, and takes the range between the 0.05 and 99.95\n"
        "percentiles of any other.",
    ),
    "quantise.directions": SceneKey(
        '"octahedral" or "paper"',
        "The 15-bit code of gradient directions: octahedral is within 1.3 degrees, the paper's 5+5+5 bits within 2.7.",
    ),
}
