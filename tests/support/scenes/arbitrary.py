"""What Hypothesis draws: views, matrices, grids, bounds; and the plain scene that tests start from."""

import itertools
import math

from hypothesis import strategies as st

from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.scene import Bounds, Image, Order, Reconstruction, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix

Quaternion = tuple[float, float, float, float]

WHITE: Colour = (1.0, 1.0, 1.0)


def plain_scene(
    opacity: float = 1.0,
    colour: Colour = WHITE,
    view: View | None = None,
    size: tuple[int, int] = (64, 64),
    order: Order = Order.BACK_TO_FRONT,
    bounds: Bounds | None = None,
    reconstruction: Reconstruction | None = None,
) -> Scene:
    """Every sample whose density byte is not 0 has this opacity and colour, with reflection as white."""
    half_a_byte = 0.5 / 255
    return Scene(
        tables=Tables(
            emit=ColourTable(points=((0.0, colour),)),
            refl=ColourTable(points=((0.0, WHITE),)),
            opac=ScalarTable(points=((0.0, 0.0), (half_a_byte, 0.0), (half_a_byte, opacity))),
        ),
        view=view or View(),
        bounds=bounds or Bounds(),
        reconstruction=reconstruction or Reconstruction(),
        order=order,
        image=Image(width=size[0], height=size[1]),
    )


def quaternion_to(target: tuple[float, float, float]) -> Quaternion:
    """The shortest rotation that brings the physical direction `target` to the viewer's z."""
    x, y, z = matrices.normalised(target)
    if z < -1 + 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    return (y, -x, 0.0, 1.0 + z)


def directions(count: int) -> list[tuple[float, float, float]]:
    """Evenly spread unit vectors (a Fibonacci spiral)."""
    golden = math.pi * (3 - math.sqrt(5))
    heights = [1 - (2 * n + 1) / count for n in range(count)]
    rings = [math.sqrt(1 - z * z) for z in heights]
    return [
        (r * math.cos(golden * n), r * math.sin(golden * n), z)
        for n, (r, z) in enumerate(zip(rings, heights, strict=True))
    ]


def flips_and_orders() -> list[tuple[tuple[int, ...], tuple[bool, ...]]]:
    """All 48 ways to store a grid: which axis comes where, and which run backwards."""
    return list(itertools.product(itertools.permutations(range(3)), itertools.product((False, True), repeat=3)))


_component = st.floats(-1, 1, allow_subnormal=False)
turns = st.tuples(_component, _component, _component, _component).filter(lambda q: sum(c * c for c in q) > 0.01)
square_turns = st.sampled_from(
    [(0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.5), (0.5, -0.5, 0.5, 0.5), (1.0, 1.0, 0.0, 0.0)]
)
upright_turns = st.floats(-3.2, 3.2).map(lambda angle: (0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)))
quaternions = st.one_of(turns, square_turns, upright_turns)
zooms = st.floats(0.25, 16)


@st.composite
def index_to_physical(draw: st.DrawFn, largest_ratio: float = 5.0, largest_skew: float = 0.5) -> Matrix:
    """Spacings up to a ratio, axes leaning on each other up to a skew, flips, and any turn."""
    spacing = [draw(st.floats(1, largest_ratio)) * draw(st.sampled_from((1.0, -1.0))) for _ in range(3)]
    lean = [draw(st.floats(-largest_skew, largest_skew)) for _ in range(3)]
    skew: Matrix = ((1.0, lean[0], lean[1]), (0.0, 1.0, lean[2]), (0.0, 0.0, 1.0))
    diagonal: Matrix = ((spacing[0], 0.0, 0.0), (0.0, spacing[1], 0.0), (0.0, 0.0, spacing[2]))
    scale = draw(st.sampled_from((0.01, 1.0, 30.0)))
    turned = matrices.product(matrices.rotation_from_quaternion(draw(quaternions)), matrices.product(skew, diagonal))
    return matrices.times(turned, scale)


@st.composite
def geometries(draw: st.DrawFn, largest: int = 12) -> Geometry:
    size = st.integers(1, largest)
    dims: Index = (draw(size), draw(size), draw(size))
    origin = (draw(st.floats(-100, 100)), draw(st.floats(-100, 100)), draw(st.floats(-100, 100)))
    return Geometry(dims, draw(index_to_physical()), origin)


@st.composite
def bounds_within(draw: st.DrawFn, dims: Index) -> Bounds:
    """Bounds that hold at least one voxel."""
    low, high = [], []
    for size in dims:
        low.append(draw(st.integers(0, size - 1)))
        high.append(draw(st.sampled_from((-1, draw(st.integers(low[-1] + 1, size))))))
    return Bounds(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


@st.composite
def views(draw: st.DrawFn, dims: Index) -> View:
    center = tuple(draw(st.floats(-2, size + 2)) for size in dims)
    return View(
        rotation=draw(quaternions),
        zoom=draw(zooms),
        center=draw(st.sampled_from(("middle", (center[0], center[1], center[2])))),
    )


@st.composite
def situations(draw: st.DrawFn, largest: int = 12) -> tuple[Scene, Geometry]:
    """A scene with some view and bounds, and a grid that they fit."""
    geometry = draw(geometries(largest))
    scene = plain_scene(
        view=draw(views(geometry.dims)),
        bounds=draw(bounds_within(geometry.dims)),
        order=draw(st.sampled_from(Order)),
        size=(draw(st.integers(1, 300)), draw(st.integers(1, 300))),
    )
    return scene, geometry
