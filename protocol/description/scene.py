"""The scene: everything that decides the image except the volume (design, sections 2, 3.9 and 5).

The same struct is the UI's state, Python's argument, the wire's message and the TOML file's content; what is declared
beside each key (scene_key) makes its comments, options, controls and docs. Intensities and opacities are 0..1,
display-referred sRGB. A scene checks itself when it is made and raises ValueError naming the field; msgspec adds the
path when it decodes one.
"""

import math
from enum import StrEnum
from typing import Annotated, Any, Literal

from volsplat.protocol.description.colours import COLOUR_ALLOWED, Colour
from volsplat.protocol.description.patches import Plane
from volsplat.protocol.description.refinement_steps import PaperStep, Step
from volsplat.protocol.description.scene_key import (
    UNIT_INTERVAL,
    Buttons,
    Key,
    Limits,
    Menu,
    Part,
    PartOf,
    Section,
    Slide,
    Swatch,
    Switch,
)
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, CrossBar, Tables
from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.upright import Up

LEAST_ZOOM, GREATEST_ZOOM = 1 / 64, 256.0  # pixels per reference spacing
LARGEST_EXTENT = 16384  # pixels, of an image along either axis


class Order(StrEnum):
    FASTEST = "fastest"  # whichever of the others draws the scene sooner (resolved_view.resolved_order)
    BACK_TO_FRONT = "btf"
    FRONT_TO_BACK = "ftb"


TRAVERSAL_ORDERS = (Order.BACK_TO_FRONT, Order.FRONT_TO_BACK)
ORDER_WORDS = {Order.BACK_TO_FRONT: "back to front", Order.FRONT_TO_BACK: "front to back"}


class Shading(Part, frozen=True):
    """The shading rules' switches: a part that is off counts as 0, modulation that is off as 1."""

    emitted: Annotated[bool, Key("Emitted light.", Switch("emitted"))] = True
    diffuse: Annotated[bool, Key("Diffuse reflection.", Switch("diffuse"))] = True
    specular: Annotated[bool, Key("Specular reflection.", Switch("specular"))] = True
    modulation: Annotated[bool, Key("Modulation of the opacity.", Switch("modulation"))] = True
    specular_power: Annotated[
        float,
        Key(
            "The n of the specular rule: a higher power gives smaller, sharper highlights.",
            Slide("specular power", step=0.01, logarithmic=True, least=1.0),
            Limits(0.0, 1000.0, above=True),
        ),
    ] = 20.0
    two_sided: Annotated[bool, Key("Light surfaces from behind, too.", Switch("two-sided"))] = False


def _slabs_share(meaning: str, label: str, tip: str) -> Key:
    """The key of a share that step G alone obeys."""
    slide = Slide(label, step=0.05, tip=f"in step G, {tip}")
    return Key(f"In step G, {meaning}. Other steps ignore it.", slide, UNIT_INTERVAL, slabs_alone=True)


class Light(Part, frozen=True):
    """The direction *towards* the light, along screen axes (world) or the volume's physical axes (grid)."""

    direction: Annotated[
        tuple[float, float, float],
        Key(
            "From the volume towards the light, along the axes that fixed_to names.",
            PartOf("light"),
            allowed="[x, y, z], any length but zero",
        ),
    ] = (0.3, 0.5, 1.0)
    fixed_to: Annotated[
        Literal["world", "grid"],
        Key(
            "World: the light stays with the viewer, along screen axes. Grid: it turns with the volume's physical"
            " axes.",
            PartOf("light"),
        ),
    ] = "world"
    shadows: Annotated[
        float,
        _slabs_share(
            "how much of the light is kept from what lies behind opaque matter",
            "cast shadows",
            "how dark the shadows are that the volume throws on itself",
        ),
    ] = 0.0
    occlusion: Annotated[
        float,
        _slabs_share(
            "how much darker is what opaque matter surrounds: ambient occlusion",
            "occlusion",
            "how dark hollows are: ambient occlusion",
        ),
    ] = 0.0
    depth_cue: Annotated[
        float,
        _slabs_share(
            "how much darker the farthest place is than the nearest",
            "depth cue",
            "how much darker the farthest place is than the nearest",
        ),
    ] = 0.0
    silhouettes: Annotated[
        float,
        _slabs_share(
            "how much darker surfaces are where they turn away from the viewer",
            "silhouettes",
            "how dark surfaces are where they turn away from you",
        ),
    ] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction == (0.0, 0.0, 0.0):
            raise ValueError("direction must not be (0, 0, 0)")


class View(Part, frozen=True):
    """Orthographic view. `rotation` is a quaternion (x, y, z, w) from upright axes to screen axes.

    `up` is the physical axis that stands upright (see upright); "auto" is what the file tells, or a guess.
    """

    rotation: Annotated[
        tuple[float, float, float, float],
        Key(
            "From upright axes (see up) to the screen's. [0, 0, 0, 1] looks from above, with the back up; the front"
            " is\n[-0.70710678, 0, 0, 0.70710678], the viewer at -y with z up.",
            PartOf("sides"),
            allowed="[x, y, z, w], a quaternion of any length but zero",
        ),
    ] = (0.0, 0.0, 0.0, 1.0)
    up: Annotated[
        Up | Literal["auto"],
        Key(
            "The physical axis that stands upright, as z, before rotation; nothing is mirrored. Auto is what the file\n"
            "tells, or a guess by the end at which what is there tapers; `volsplat info` says which.",
            PartOf("up"),
        ),
    ] = "auto"
    zoom: Annotated[
        float | Literal["fit"],
        Key(
            "The reference spacing is the cube root of a voxel's volume. Fit shows all that is visible under the\n"
            "tables and bounds: its outline fills a still; on the page and in movies, which turn, a ball does. "
            "Scripts that turn a volume take a number: each side has a fit of its own.",
            PartOf("moves"),
            Limits(LEAST_ZOOM, GREATEST_ZOOM),
            "pixels per voxel",
            allowed='1/64 to 256 pixels per reference spacing, or "fit"',
        ),
    ] = "fit"
    center: Annotated[
        tuple[float, float, float] | Literal["middle"],
        Key(
            "The grid point shown at the image's centre. Middle is that of the grid, or of what a fit shows.",
            PartOf("centre"),
            allowed='[i, j, k] in voxels, fractions allowed, or "middle"',
        ),
    ] = "middle"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.rotation):
            raise ValueError("rotation must not be all zeros")


class Bounds(Part, frozen=True):
    """The part of the grid that is drawn: low <= (i, j, k) < high; -1 in `high` means up to the end."""

    low: Annotated[
        Index, Key("The first voxel on each axis.", PartOf("bounds"), allowed="[i, j, k], whole voxels from 0")
    ] = (0, 0, 0)
    high: Annotated[
        Index,
        Key(
            "One past the last voxel on each axis.",
            PartOf("bounds"),
            allowed="[i, j, k], whole voxels, above low; -1 means up to the end",
        ),
    ] = (-1, -1, -1)


class Kernel(StrEnum):
    """Radially symmetric reconstruction kernels, each with a default radius in voxels (see docs)."""

    GAUSSIAN = "gaussian"
    BSPLINE = "bspline"
    KAISER_BESSEL = "kaiser-bessel"
    CONE = "cone"


class SlabKernel(StrEnum):
    """Those of step G, radially symmetric as well; see protocol/rules/slab_kernels.py."""

    GAUSSIAN = "gaussian"
    BSPLINE = "bspline"
    KAISER_BESSEL = "kaiser-bessel"
    CONE = "cone"
    BALANCED = "balanced"
    CRISP = "crisp"
    QUASI_INTERPOLATING = "quasi-interpolating"


class Reconstruction(Part, frozen=True):
    kernel: Annotated[Kernel, Key("The shape of the kernel of steps A to F.", Menu("kernel"))] = Kernel.GAUSSIAN
    radius: Annotated[
        float | Literal["default"],
        Key(
            "Where that kernel is cut. A smaller one is faster, a larger one smoother.",
            Slide("radius", step=0.1, tip="in voxels, where the kernel is cut"),
            Limits(1.0, 4.0),
            "voxels",
        ),
    ] = "default"
    precise: Annotated[
        bool,
        Key(
            "Footprints at all 64 offsets a pixel, however large they are: for final images. Takes up to twice as"
            " long\nwhere voxels are large. Steps A to C look along each pixel's ray, however small voxels are.\nA"
            " prepared volume is drawn from its own voxels at any zoom, as far as memory allows, and not from means of"
            " them.",
            Switch("precise footprints"),
        ),
    ] = False
    slab: Annotated[
        float,
        Key(
            "How far apart the planes of step G are. Thinner slabs are slower.",
            Slide("slab", step=0.05, tip="in voxels, from one plane of step G to the next"),
            Limits(0.25, 2.0),
            "voxels",
            slabs_alone=True,
        ),
    ] = 1.0
    slab_kernel: Annotated[
        SlabKernel,
        Key(
            "The shape of the kernel of step G. The last three have weights below 0 as well, and blur least: balanced"
            " is between blur\nand ringing, the other two are sharper still.",
            Menu("slab kernel"),
            slabs_alone=True,
        ),
    ] = SlabKernel.BALANCED


class Refine(Part, frozen=True):
    """How the image refines. `bare_buffer` shows partial images without the finished step under them.

    `striding` has steps A and B leave out voxels of a prepared volume too, as in the paper, instead of taking means.
    """

    lit_from: Annotated[
        PaperStep,
        Key(
            "The step at which diffuse light joins; specular joins one step later, at F, when this is E.",
            Buttons("lit from step"),
        ),
    ] = PaperStep.E
    finest: Annotated[
        Step,
        Key(
            "The step that refinement ends with on the page; what moves is drawn by none after it. G is crisp at any"
            " zoom, and slower, and drawn as F while things move.",
            Buttons("refine to"),
        ),
    ] = Step.F
    bare_buffer: Annotated[
        bool,
        Key(
            "Show a step's partial image alone, as in the paper, not over the finished step before it.",
            Switch("bare buffer", "show what is being drawn without the finished step under it"),
        ),
    ] = False
    striding: Annotated[
        bool,
        Key(
            "Of a prepared volume, A and B leave out voxels, as in the paper, instead of drawing means.",
            Switch(
                "striding",
                "steps A and B leave out voxels, as in the paper, instead of drawing the means of a coarser level",
            ),
        ),
    ] = False


class Image(Part, frozen=True):
    """The picture. `background` lies under PNG, JPEG and the page, never under EXR or the returned tensor."""

    width: Annotated[int, Key("The picture's width.", PartOf("size"), Limits(1, LARGEST_EXTENT), "pixels")] = 512
    height: Annotated[int, Key("The picture's height.", PartOf("size"), Limits(1, LARGEST_EXTENT), "pixels")] = 512
    background: Annotated[
        Colour,
        Key(
            "Lies under the picture in PNG, JPEG, TIFF and the page; EXR keeps its transparency instead.",
            Swatch("background"),
            UNIT_INTERVAL,
            allowed=COLOUR_ALLOWED,
        ),
    ] = (0.0, 0.0, 0.0)
    edges: Annotated[
        bool,
        Key("Draw the volume's boundary as white edges.", Switch("white edges of the volume")),
    ] = False


class Quantise(Part, frozen=True):
    """How voxels become 8 bits: the density window in the data's own units, and the code of directions."""

    window: Annotated[
        tuple[float, float] | Literal["auto"],
        Key(
            "These values become density 0 and 255. Auto keeps 8-bit data, takes the whole range of labels, and\n"
            "the range between the 0.05 and 99.95 percentiles of any other.",
            PartOf("density window"),
            allowed='[low, high] in the volume\'s own units, or "auto"',
        ),
    ] = "auto"
    directions: Annotated[
        Literal["octahedral", "paper"],
        Key(
            "The 15-bit code of gradient directions: octahedral is within 1.3 degrees, the paper's 5+5+5 bits within"
            " 2.7.",
            Buttons(
                "directions",
                tip="the code of gradient directions: octahedral is finer, the paper’s bands under sharp highlights",
            ),
        ),
    ] = "octahedral"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.window, str):
            if self.window[0] >= self.window[1]:
                raise ValueError(f"window must rise, not {list(self.window)}")
            if not 0.0 < (TABLE_ENTRIES - 1) / (self.window[1] - self.window[0]) < math.inf:
                raise ValueError(f"window must be neither too narrow nor too wide for float64, not {list(self.window)}")


class Scene(Part, frozen=True):
    """All that a person sets."""

    tables: Annotated[
        Tables,
        Section(
            "The four shading tables of 256 entries. A table is given by points that are joined by straight lines;\n"
            "position 0 is entry 0, position 1 is entry 255. Two points at one position make a step. Before the first"
            " and\nafter the last point a table is constant. All colours are display-referred sRGB."
        ),
    ]
    cross_bar: Annotated[
        CrossBar,
        Section(
            "Which field of a voxel indexes each table. Density is windowed (see quantise.window); strength is\n"
            "the gradient's length; gradient-i, -j, -k is its direction; screen-x runs right, screen-y up, screen-z"
            " towards\nthe viewer, all three over the volume's bounding sphere; grid-i, -j, -k run over the whole"
            " volume."
        ),
    ] = CrossBar()
    plane: Annotated[
        Plane,
        Section(
            "A table over two fields at once, density and gradient strength. With patches it takes the place of the"
            " four\ntables, the cross-bar and the modulation; without any there is none."
        ),
    ] = Plane()
    shading: Annotated[
        Shading,
        Section("Switches for the parts of the shading rules. A part that is off counts as 0, modulation as 1."),
    ] = Shading()
    light: Annotated[Light, Section("One light, infinitely far away.")] = Light()
    view: Annotated[View, Section("The orthographic view. Screen x runs right, y up, z towards the viewer.")] = View()
    bounds: Annotated[Bounds, Section("The part of the grid that is drawn: low <= (i, j, k) < high.")] = Bounds()
    reconstruction: Annotated[
        Reconstruction, Section("The kernel that carries samples to the screen in the steps D to G.")
    ] = Reconstruction()
    order: Annotated[
        Order,
        Key(
            "Combine samples back to front, so that what is later hidden can be watched, or front to back.\n"
            "Fastest is front to back wherever something can be hidden.",
            Buttons("order", labelled=False, words=ORDER_WORDS),
        ),
    ] = Order.FASTEST
    refine: Annotated[Refine, Section("How the image refines, step by step.")] = Refine()
    image: Annotated[Image, Section("The picture.")] = Image()
    quantise: Annotated[
        Quantise,
        Section("How the volume's values become the 8 bits that index the tables. A change reads the volume anew."),
    ] = Quantise()

    def with_(self, **changes: Any) -> "Scene":
        """The scene with other values, by the names of its keys: `scene.with_(zoom=2, background="white")`.

        Also size=300 or (width, height), rotation="front" or (azimuth, elevation[, roll]) in degrees, and of the
        tables points as [(position, value), ...]. Raises BadInput for what a scene does not have, naming the cure.
        """
        from volsplat.protocol.description.scene_changes import changed  # which knows the scene

        return changed(self, changes)
