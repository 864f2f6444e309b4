"""The scene: everything that decides the image except the volume (design, sections 2, 3.9 and 5).

The same struct is the UI's state, Python's argument, the wire's message and the TOML file's content. Intensities
and opacities are 0..1, display-referred sRGB. A scene checks itself when it is made and raises ValueError naming
the field; msgspec adds the path when it decodes one.
"""

import math
from enum import StrEnum
from typing import Literal

import msgspec

from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.upright import Up

Colour = tuple[float, float, float]

TABLE_ENTRIES = 256
LARGEST_EXTENT = 16384  # pixels, of an image along either axis
LEAST_ZOOM, GREATEST_ZOOM = 1 / 64, 256.0  # pixels per reference spacing


def _check_finite(name: str, values: tuple[float, ...]) -> None:
    if not all(math.isfinite(value) for value in values):
        raise ValueError(f"{name} must be finite, not {list(values)}")


def _check_unit(name: str, value: float) -> None:
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"{name} must be 0 to 1, not {value}")


def _check_positions(positions: list[float]) -> None:
    if not positions:
        raise ValueError("a table needs at least one point")
    for position in positions:
        _check_unit("a point's position", position)
    if any(later < earlier for earlier, later in zip(positions, positions[1:], strict=False)):
        raise ValueError(f"points must be in rising order of position, not {positions}")


def _interpolated(points: list[tuple[float, float]]) -> list[float]:
    """The table's 256 entries at positions n / 255, by straight lines between points."""
    entries = []
    right = 0
    for n in range(TABLE_ENTRIES):
        position = n / (TABLE_ENTRIES - 1)
        while right < len(points) and points[right][0] <= position:
            right += 1
        if right == 0:
            entries.append(points[0][1])
        elif right == len(points):
            entries.append(points[-1][1])
        else:
            (p0, v0), (p1, v1) = points[right - 1], points[right]
            entries.append(v0 + (v1 - v0) * ((position - p0) / (p1 - p0)))
    return entries


class Field(StrEnum):
    """A packet field that can index a table through the cross-bar; each is 8 bits (see index_rules)."""

    DENSITY = "density"
    STRENGTH = "strength"
    GRADIENT_I = "gradient-i"
    GRADIENT_J = "gradient-j"
    GRADIENT_K = "gradient-k"
    SCREEN_X = "screen-x"
    SCREEN_Y = "screen-y"
    SCREEN_Z = "screen-z"
    GRID_I = "grid-i"
    GRID_J = "grid-j"
    GRID_K = "grid-k"


class Order(StrEnum):
    FASTEST = "fastest"  # whichever of the others draws the scene sooner (frame_plan.resolved_order)
    BACK_TO_FRONT = "btf"
    FRONT_TO_BACK = "ftb"


TRAVERSAL_ORDERS = (Order.BACK_TO_FRONT, Order.FRONT_TO_BACK)


class Step(StrEnum):
    """The paper's six steps of successive refinement."""

    A = "A"
    B = "B"
    C = "C"
    D = "D"
    E = "E"
    F = "F"


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the scene's parts: immutable, keyword-only, strict about unknown keys."""


class ColourTable(Part, frozen=True):
    """256 colours, given as points (position 0..1, colour) that are joined by straight lines.

    Positions must not fall; two points at one position make a step. Before the first and after the last point
    the table is constant. A freehand table is one point for each entry, at n / 255.
    """

    points: tuple[tuple[float, Colour], ...]

    def __post_init__(self) -> None:
        _check_positions([position for position, _ in self.points])
        for _, colour in self.points:
            for channel in colour:
                _check_unit("a colour channel", channel)

    def entries(self) -> list[Colour]:
        channels = [_interpolated([(p, c[n]) for p, c in self.points]) for n in range(3)]
        return list(zip(*channels, strict=True))


class ScalarTable(Part, frozen=True):
    """256 opacities 0..1, given as points (position 0..1, value); see ColourTable."""

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        _check_positions([position for position, _ in self.points])
        for _, value in self.points:
            _check_unit("a table value", value)

    @property
    def greatest(self) -> float:
        """No entry is greater."""
        return max(value for _, value in self.points)

    def entries(self) -> list[float]:
        return _interpolated(list(self.points))


class Tables(Part, frozen=True):
    """The four shading tables (paper: "Shading")."""

    emit: ColourTable
    refl: ColourTable
    opac: ScalarTable
    modu: ScalarTable = ScalarTable(points=((0.0, 1.0),))


class CrossBar(Part, frozen=True):
    """Which packet field indexes each table."""

    emit: Field = Field.DENSITY
    refl: Field = Field.DENSITY
    opac: Field = Field.DENSITY
    modu: Field = Field.STRENGTH


class Shading(Part, frozen=True):
    """The shading rules' switches: a part that is off counts as 0, modulation that is off as 1."""

    emitted: bool = True
    diffuse: bool = True
    specular: bool = True
    modulation: bool = True
    specular_power: float = 20.0
    two_sided: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.specular_power) and 0 < self.specular_power <= 1000):
            raise ValueError(f"specular_power must be above 0 and at most 1000, not {self.specular_power}")


class Light(Part, frozen=True):
    """The direction *towards* the light, along screen axes (world) or the volume's physical axes (grid)."""

    direction: tuple[float, float, float] = (0.3, 0.5, 1.0)
    fixed_to: Literal["world", "grid"] = "world"

    def __post_init__(self) -> None:
        _check_finite("direction", self.direction)
        if self.direction == (0.0, 0.0, 0.0):
            raise ValueError("direction must not be (0, 0, 0)")


class View(Part, frozen=True):
    """Orthographic view. `rotation` is a quaternion (x, y, z, w) from upright axes to screen axes.

    `up` is the physical axis that stands upright (see upright); "auto" is what the file tells, or a guess.
    """

    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    up: Up | Literal["auto"] = "auto"
    zoom: float | Literal["fit"] = "fit"  # pixels per reference spacing
    center: tuple[float, float, float] | Literal["middle"] = "middle"  # grid point at the image's centre

    def __post_init__(self) -> None:
        _check_finite("rotation", self.rotation)
        if not any(self.rotation):
            raise ValueError("rotation must not be all zeros")
        if not isinstance(self.zoom, str) and not LEAST_ZOOM <= self.zoom <= GREATEST_ZOOM:
            raise ValueError(f'zoom must be 1/64 to 256 pixels per voxel or "fit", not {self.zoom}')
        if not isinstance(self.center, str):
            _check_finite("center", self.center)


class Bounds(Part, frozen=True):
    """The part of the grid that is drawn: low <= (i, j, k) < high; -1 in `high` means up to the end."""

    low: Index = (0, 0, 0)
    high: Index = (-1, -1, -1)


class Kernel(StrEnum):
    """Radially symmetric reconstruction kernels, each with a default radius in voxels (see docs)."""

    GAUSSIAN = "gaussian"
    BSPLINE = "bspline"
    KAISER_BESSEL = "kaiser-bessel"
    CONE = "cone"


class Reconstruction(Part, frozen=True):
    kernel: Kernel = Kernel.GAUSSIAN
    radius: float | Literal["default"] = "default"  # where the kernel is cut, in voxels

    def __post_init__(self) -> None:
        if not isinstance(self.radius, str) and not 1.0 <= self.radius <= 4.0:
            raise ValueError(f'radius must be 1 to 4 voxels or "default", not {self.radius}')


class Refine(Part, frozen=True):
    """How the image refines. `bare_buffer` shows partial images without the finished step under them.

    `striding` has steps A and B leave out voxels of a prepared volume too, as in the paper, instead of taking means.
    """

    lit_from: Step = Step.E
    bare_buffer: bool = False
    striding: bool = False


class Image(Part, frozen=True):
    """The picture. `background` lies under PNG, JPEG and the page, never under EXR or the returned tensor."""

    width: int = 512
    height: int = 512
    background: Colour = (0.0, 0.0, 0.0)
    edges: bool = False  # the white edges of the paper's plates

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not 1 <= getattr(self, name) <= LARGEST_EXTENT:
                raise ValueError(f"{name} must be 1 to {LARGEST_EXTENT} pixels, not {getattr(self, name)}")
        for channel in self.background:
            _check_unit("a background channel", channel)


class Quantise(Part, frozen=True):
    """How voxels become 8 bits: the density window in the data's own units, and the code of directions."""

    window: tuple[float, float] | Literal["auto"] = "auto"
    directions: Literal["octahedral", "paper"] = "octahedral"

    def __post_init__(self) -> None:
        if not isinstance(self.window, str):
            _check_finite("window", self.window)
            if self.window[0] >= self.window[1]:
                raise ValueError(f"window must rise, not {list(self.window)}")
            if not 0.0 < (TABLE_ENTRIES - 1) / (self.window[1] - self.window[0]) < math.inf:
                raise ValueError(f"window must be neither too narrow nor too wide for float64, not {list(self.window)}")


class Scene(Part, frozen=True):
    """All that a person sets."""

    tables: Tables
    cross_bar: CrossBar = CrossBar()
    shading: Shading = Shading()
    light: Light = Light()
    view: View = View()
    bounds: Bounds = Bounds()
    reconstruction: Reconstruction = Reconstruction()
    order: Order = Order.FASTEST
    refine: Refine = Refine()
    image: Image = Image()
    quantise: Quantise = Quantise()
