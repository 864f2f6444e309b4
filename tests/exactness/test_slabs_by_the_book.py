"""docs/how_it_works/slab_image.md suffices to draw step G: what was written from it alone draws the programs' image."""

from typing import Any

import msgspec
import numpy as np
import pytest
import torch
from torch import Tensor

from by_the_book.book import SlabBook
from by_the_book.slabs import draw_slabs
from reference.level_means import halved, sides_of
from support.scenes.of_the_book import FIELDS, MATRICES, PATCHES, ROTATIONS, STRENGTH_SCALE, WINDOW, book, scene, volume
from support.scenes.rendering import rendered
from tolerances import ONE_LEVEL
from volsplat.mapshade_server.prepare.layout import halved_geometry
from volsplat.protocol.description.patches import Plane
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Image, Kernel, Order, Reconstruction, Scene, SlabKernel, View
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import Resolution

WHOLE = Bounds()
ZOOMS, SLABS = (0.6, 1.0, 2.3, 4.1), (0.5, 1.0, 2.0)
DIMMED = ("shadows", "occlusion", "depth_cue", "silhouettes")
# Each pair of a matrix and a rotation, and of either and a zoom.
CASES = [
    (matrix, rotation, ZOOMS[(number + 2 * n) % 4])
    for n, matrix in enumerate(MATRICES)
    for number, rotation in enumerate(ROTATIONS)
]


def sliced(seed: int, dims: Index, view: View, bounds: Bounds = WHOLE, **dimming: float) -> Scene:
    """One that has a bit of everything that step G heeds."""
    one = scene(seed, view, Order.FRONT_TO_BACK, Kernel.GAUSSIAN, seed % 2 == 0, bounds)
    return msgspec.structs.replace(
        one,
        light=msgspec.structs.replace(one.light, **dimming),
        reconstruction=Reconstruction(slab=SLABS[seed % 3], slab_kernel=list(SlabKernel)[seed % 7]),
    )


def difference(
    values: Tensor, geometry: Geometry, one: Scene, octahedral: bool = True, level: Geometry | None = None
) -> float:
    """`values` are those of the level, if there is one."""
    quantisation = Quantisation(WINDOW, STRENGTH_SCALE, "octahedral" if octahedral else "paper")
    resolution = Resolution(1, level, 1) if level else None
    programs = rendered(values, geometry, one, Step.G, quantisation, resolution=resolution)
    plain = vars(book(values, geometry, one, Step.G, octahedral)) | {"kernel": one.reconstruction.slab_kernel.value}
    if level:
        plain |= of_level(plain, geometry, level)
    dimming = {name: getattr(one.light, name) for name in DIMMED}
    drawn = torch.from_numpy(draw_slabs(SlabBook(**plain, slab=one.reconstruction.slab, **dimming)))
    assert programs.shape == drawn.shape and float(programs[..., 3].max()) > 0.05
    return float((programs - drawn).abs().max())


def of_level(plain: dict[str, Any], geometry: Geometry, level: Geometry) -> dict[str, Any]:
    n = np.linalg.norm(level.index_to_physical, axis=0) / np.linalg.norm(geometry.index_to_physical, axis=0)
    factors = np.rint(n).astype(int)
    low, high = np.array(plain["bounds"])
    return {
        "to_physical": np.array(level.index_to_physical),
        "zoom": plain["zoom"] * level.reference_spacing / geometry.reference_spacing,
        "center": tuple((np.array(plain["center"]) + 0.5) / factors - 0.5),
        "bounds": (tuple(low // factors), tuple(-(-high // factors))),
        "factors": tuple(factors),
        "whole": geometry.dims,
    }


@pytest.mark.parametrize(("matrix", "rotation", "zoom"), CASES)
def test_the_page_suffices(matrix: str, rotation: str, zoom: float) -> None:
    seed = CASES.index((matrix, rotation, zoom))
    dims = (6, 9, 7) if zoom > 1 else (11, 9, 10)
    bounds = Bounds(low=(1, 0, 1), high=(-1, 8, 5)) if seed % 4 == 1 else WHOLE
    view = View(rotation=ROTATIONS[rotation], zoom=zoom, center=(2.3, 4.0, 3.1) if seed % 3 else "middle", up="+z")
    dimming = {name: 0.3 + 0.1 * n for n, name in enumerate(DIMMED) if (seed >> n) % 2}
    one = sliced(seed, dims, view, bounds, **dimming)
    assert difference(volume(seed, dims), Geometry(dims, MATRICES[matrix]), one, seed % 3 != 1) <= ONE_LEVEL


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("other", [Field.DENSITY, Field.STRENGTH])
def test_it_suffices_whatever_indexes_tables(field: Field, other: Field) -> None:
    dims, seed = (8, 7, 9), 1 + FIELDS.index(field)
    one = sliced(seed, dims, View(rotation=ROTATIONS["oblique"], zoom=1.7, up="+z"))
    one = msgspec.structs.replace(
        one,
        cross_bar=CrossBar(other, field, other, field)
        if other == Field.DENSITY
        else CrossBar(field, other, field, other),
        shading=msgspec.structs.replace(one.shading, modulation=True),
    )
    assert difference(volume(seed, dims), Geometry(dims, MATRICES["unequal"]), one) <= ONE_LEVEL


STEEP = ScalarTable(((0.0, 0.0), (0.3, 0.0), (0.6, 1.0)))
RAINBOW = ColourTable(((0.0, (0.0, 0.0, 1.0)), (0.5, (0.0, 1.0, 0.0)), (1.0, (1.0, 0.0, 0.0))))


@pytest.mark.parametrize(
    ("opac", "modu", "cross_bar"),
    [
        (STEEP, (0.3, 0.3), CrossBar(modu=Field.STRENGTH)),  # the same everywhere, and so as good as density's
        ((0.7, 0.7), STEEP, CrossBar(opac=Field.GRID_I, modu=Field.DENSITY)),
        ((0.998, 0.998), (0.9, 0.9), CrossBar(opac=Field.GRID_I, modu=Field.SCREEN_X)),
        (STEEP, (0.997, 0.9985), CrossBar(modu=Field.GRID_J)),  # nearly opaque, where depth is steep
    ],
)
def test_it_suffices_for_opacities_that_hardly_change_or_not_at_all(
    opac: ScalarTable | tuple[float, float], modu: ScalarTable | tuple[float, float], cross_bar: CrossBar
) -> None:
    dims = (9, 9, 9)
    tables = [t if isinstance(t, ScalarTable) else ScalarTable(((0.0, t[0]), (1.0, t[1]))) for t in (opac, modu)]
    one = Scene(
        tables=Tables(RAINBOW, RAINBOW, *tables),
        cross_bar=cross_bar,
        view=View(rotation=ROTATIONS["oblique"], zoom=2.3, up="+z"),
        reconstruction=Reconstruction(slab=0.5),
        image=Image(width=27, height=24),
    )
    assert difference(volume(3, dims), Geometry(dims), one) <= ONE_LEVEL


@pytest.mark.parametrize("seed", [4, 8])
def test_it_suffices_for_patches_over_density_and_strength(seed: int) -> None:
    dims = (9, 8, 10)
    one = sliced(seed, dims, View(rotation=ROTATIONS["oblique"], zoom=1.7, up="+z"), shadows=0.5)
    one = msgspec.structs.replace(one, plane=Plane(patches=PATCHES))
    assert difference(volume(seed, dims), Geometry(dims, MATRICES["skewed"]), one) <= ONE_LEVEL


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 1.0, 0.0), (0.3, -0.9, 0.2)])
def test_it_suffices_for_light_dimmed_by_blocks_of_several_voxels(direction: tuple[float, float, float]) -> None:
    dims = (75, 4, 5)  # 38 blocks of 2, 1 and 1, the last of one voxel
    view = View(rotation=ROTATIONS["rolled"], zoom=1.3, center=(60.0, 2.0, 2.0), up="+z")
    bounds = Bounds(low=(50, 0, 0), high=(74, -1, -1))
    one = sliced(6, dims, view, bounds, shadows=0.9, occlusion=0.8)
    light = msgspec.structs.replace(one.light, direction=direction, fixed_to="grid")
    one = msgspec.structs.replace(one, light=light, cross_bar=CrossBar())
    assert difference(volume(6, dims), Geometry(dims, MATRICES["unequal"]), one) <= ONE_LEVEL


@pytest.mark.parametrize(("seed", "matrix"), [(3, "skewed"), (5, "cubic"), (10, "unequal")])
def test_it_suffices_for_levels(seed: int, matrix: str) -> None:
    dims = (15, 12, 13)
    geometry = Geometry(dims, MATRICES[matrix])
    level = halved_geometry(geometry)
    values = halved(volume(seed, dims), sides_of(dims[::-1], level.dims[::-1]))
    view = View(rotation=ROTATIONS["oblique"], zoom=1.1, center=(6.2, 5.1, 7.3), up="+z")
    one = sliced(seed, dims, view, Bounds(low=(3, 0, 1), high=(12, 11, -1)), shadows=0.8, occlusion=0.6, depth_cue=0.5)
    one = msgspec.structs.replace(
        one,
        image=Image(width=27, height=24),
        cross_bar=CrossBar(Field.GRID_I, Field.SCREEN_X, modu=Field.STRENGTH),
    )
    assert difference(values, geometry, one, level=level) <= ONE_LEVEL
