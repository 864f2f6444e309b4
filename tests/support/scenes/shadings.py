"""What Hypothesis draws for the map/shade kernels: volumes with holes, tables, cross-bars, lights and partitions."""

from typing import Literal

import torch
from hypothesis import strategies as st
from torch import Tensor

from support.scenes.arbitrary import bounds_within, views
from volsplat.protocol.description.patches import Patch, Patches, Plane
from volsplat.protocol.description.refinement_steps import PaperStep
from volsplat.protocol.description.scene import Image, Light, Order, Refine, Scene, Shading
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.rules.index_rules import Quantisation

WINDOW = (-2.0, 2.0)
WIDE_IMAGE = Image(width=8192, height=8192)  # holds all of a small volume at any of the zooms that are drawn

SAME: Literal["same"] = "same"
units = st.floats(0, 1)
Scheme = Literal["octahedral", "paper"]
SCHEMES: tuple[Scheme, ...] = ("octahedral", "paper")
directions = st.sampled_from(SCHEMES)


@st.composite
def volumes(draw: st.DrawFn, geometry: Geometry) -> Tensor:
    """float64 (k, j, i): noise with flat parts, some voxels NaN or infinite."""
    generator = torch.Generator().manual_seed(draw(st.integers(0, 2**31)))
    shape = geometry.dims[::-1]
    values = torch.randn(shape, generator=generator, dtype=torch.float64)
    flat = torch.rand(shape, generator=generator) < draw(st.sampled_from((0.0, 0.5)))
    holes = torch.rand(shape, generator=generator) < draw(st.sampled_from((0.0, 0.1, 0.5)))
    empty = draw(st.sampled_from((torch.nan, torch.inf, -torch.inf)))
    return torch.where(holes, empty, torch.where(flat, 0.25, values))


@st.composite
def quantisations(draw: st.DrawFn) -> Quantisation:
    return Quantisation(window=WINDOW, strength_scale=draw(st.floats(0, 300)), directions=draw(directions))


@st.composite
def colour_tables(draw: st.DrawFn) -> ColourTable:
    colours = draw(st.lists(st.tuples(units, units, units), min_size=1, max_size=4))
    return ColourTable(points=tuple((n / len(colours), colour) for n, colour in enumerate(colours)))


@st.composite
def scalar_tables(draw: st.DrawFn) -> ScalarTable:
    """Often 0 over a stretch, so that some samples are transparent."""
    values = draw(st.lists(st.sampled_from((0.0, 1.0)) | units, min_size=1, max_size=4))
    stepped = [(n / len(values) + side, value) for n, value in enumerate(values) for side in (0.0, 0.01)]
    return ScalarTable(points=tuple(stepped))


@st.composite
def ends(draw: st.DrawFn) -> tuple[float, float]:
    """Often at the plane's own ends, and of one place."""
    place = units | st.sampled_from((0.0, 1.0)) | st.integers(0, 255).map(lambda n: n / 255)
    one, other = draw(place), draw(place)
    return min(one, other), max(one, other)


@st.composite
def patches(draw: st.DrawFn, least: int = 1) -> Patches:
    """Trapezia, triangles and rectangles that may overlap."""
    colour = st.tuples(units, units, units)
    drawn = [
        Patch(
            density=draw(ends()),
            strength=draw(ends().filter(lambda rising: rising[0] < rising[1])),
            top=draw(st.just(SAME) | ends()),
            soft=draw(st.sampled_from((0.0, 1.0)) | units),
            opacity=draw(st.just(1.0) | units),
            emit=draw(st.just((0.0, 0.0, 0.0)) | colour),
            refl=draw(colour),
        )
        for _ in range(draw(st.integers(least, 4)))
    ]
    return tuple(drawn)


@st.composite
def shaded_scenes(draw: st.DrawFn, geometry: Geometry, image: Image = WIDE_IMAGE) -> Scene:
    """Any tables, cross-bar, light and view that a volume of this geometry can be drawn with."""
    fields = st.sampled_from(Field)
    component = st.floats(-1, 1, allow_subnormal=False)
    return Scene(
        tables=Tables(
            emit=draw(colour_tables()),
            refl=draw(colour_tables()),
            opac=draw(scalar_tables()),
            modu=draw(scalar_tables()),
        ),
        cross_bar=CrossBar(emit=draw(fields), refl=draw(fields), opac=draw(fields), modu=draw(fields)),
        plane=Plane(patches=draw(st.just(()) | patches())),
        shading=Shading(
            emitted=draw(st.booleans()),
            diffuse=draw(st.booleans()),
            specular=draw(st.booleans()),
            modulation=draw(st.booleans()),
            specular_power=draw(st.sampled_from((0.5, 1.0, 20.0, 1000.0))),
            two_sided=draw(st.booleans()),
        ),
        light=Light(
            direction=draw(
                st.sampled_from(((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)))
                | st.tuples(component, component, component).filter(lambda d: sum(c * c for c in d) > 0.01)
            ),
            fixed_to=draw(st.sampled_from(("world", "grid"))),
        ),
        view=draw(views(geometry.dims)),
        bounds=draw(bounds_within(geometry.dims)),
        order=draw(st.sampled_from(Order)),
        refine=Refine(lit_from=draw(st.sampled_from(PaperStep))),
        image=image,
    )


@st.composite
def partitions(draw: st.DrawFn, geometry: Geometry) -> list[Box]:
    """Boxes that together are the whole grid, in any order."""
    boxes = [geometry.box]
    for _ in range(draw(st.integers(0, 5))):
        box = boxes.pop(draw(st.integers(0, len(boxes) - 1)))
        axis = draw(st.integers(0, 2))
        cut = draw(st.integers(box.low[axis], box.high[axis]))
        if not box.low[axis] < cut < box.high[axis]:
            boxes.append(box)
            continue
        high, low = list(box.high), list(box.low)
        high[axis] = low[axis] = cut
        boxes.append(Box(box.low, (high[0], high[1], high[2])))
        boxes.append(Box((low[0], low[1], low[2]), box.high))
    return draw(st.permutations(boxes))
