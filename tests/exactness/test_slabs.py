"""Step G against its float64 reference, and what must hold of it whatever the view is."""

from typing import Any

import msgspec
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from torch import Tensor

from reference import slabs, voxel_packets
from support.scenes.arbitrary import turns
from support.scenes.phantoms import QUANTISATION, shaded_scene, shells
from support.scenes.rendering import rendered
from support.thoroughness import examples
from tolerances import FEW_TIES, MEAN_RING, MISMATCHED_SLABS, ONE_LEVEL, UNEVEN_BALL, UNEVEN_BALL_OVERSHOT
from volsplat.protocol.description.patches import Patch, Plane
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import (
    TRAVERSAL_ORDERS,
    Bounds,
    Light,
    Order,
    Reconstruction,
    Scene,
    SlabKernel,
    View,
)
from volsplat.protocol.description.shading_tables import CrossBar, Field, ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices

SIZE = 14
PIXELS = 36
SKEWED = Geometry((SIZE, SIZE, SIZE), ((0.8, 0.1, 0.0), (0.0, 0.9, 0.0), (0.05, 0.0, 1.3)))
CUBIC = Geometry((SIZE, SIZE, SIZE))
OBLIQUE = View(rotation=(0.1, 0.2, 0.3, 0.9), zoom=1.9)


def scene_of(view: View, reconstruction: Reconstruction | None = None, **changes: object) -> Scene:
    scene = shaded_scene(view, (PIXELS, PIXELS))
    return msgspec.structs.replace(scene, reconstruction=reconstruction or Reconstruction(), **changes)


def difference(scene: Scene, geometry: Geometry, exact: bool, values: Tensor | None = None) -> Tensor:
    values = shells(SIZE) if values is None else values
    packets = voxel_packets.pack(values, geometry, QUANTISATION)
    expected = slabs.render(packets, geometry, QUANTISATION, scene, exact)
    assert expected[..., 3].max() > 0.2
    return (expected - rendered(values, geometry, scene, Step.G)).abs().amax(dim=-1)


@settings(max_examples=examples(8))
@given(turns, st.floats(0.3, 3.0), st.sampled_from(SlabKernel), st.floats(0.5, 2.0), st.sampled_from([CUBIC, SKEWED]))
@example((0.0, 0.0, 0.0, 1.0), 2.0, SlabKernel.BALANCED, 1.0, CUBIC)
@example((0.3, 0.1, 0.2, 0.9), 1.3, SlabKernel.BALANCED, 1.0, SKEWED)
@example((0.0, 0.0, 0.0, 1.0), 2.0, SlabKernel.KAISER_BESSEL, 1.0, CUBIC)
@example((0.0, 0.0, 0.0, 1.0), 0.3, SlabKernel.KAISER_BESSEL, 1.0, CUBIC)
def test_on_the_same_integers_it_is_the_references(
    rotation: tuple[float, float, float, float], zoom: float, kernel: SlabKernel, slab: float, geometry: Geometry
) -> None:
    scene = scene_of(View(rotation=rotation, zoom=zoom), Reconstruction(slab_kernel=kernel, slab=slab))
    assert difference(scene, geometry, exact=False).max() <= ONE_LEVEL


@pytest.mark.parametrize("view", [OBLIQUE, View(zoom=1.9)])
def test_quantised_positions_and_weights_cost_little(view: View) -> None:
    off = difference(scene_of(view), SKEWED, exact=True)
    assert (off > ONE_LEVEL).double().mean() <= MISMATCHED_SLABS


FALLING = ScalarTable(points=((0.0, 1.0), (1.0, 0.2)))


@pytest.mark.parametrize(
    "cross_bar",
    [
        CrossBar(emit=Field.GRADIENT_I, refl=Field.STRENGTH, modu=Field.SCREEN_Z),
        CrossBar(emit=Field.GRID_K, refl=Field.GRADIENT_K, modu=Field.DENSITY),
        CrossBar(emit=Field.SCREEN_X, refl=Field.SCREEN_Y, opac=Field.STRENGTH, modu=Field.DENSITY),
        CrossBar(opac=Field.GRID_I, modu=Field.GRADIENT_J),
    ],
)
def test_every_field_indexes_every_table(cross_bar: CrossBar) -> None:
    scene = scene_of(OBLIQUE, cross_bar=cross_bar)
    tables = msgspec.structs.replace(scene.tables, modu=FALLING)
    off = difference(msgspec.structs.replace(scene, tables=tables), SKEWED, exact=False)
    assert (off > ONE_LEVEL).double().mean() <= FEW_TIES  # where a byte is a hair from the next one


PLANE = Plane(
    patches=(
        Patch(density=(0.1, 0.9), strength=(0.0, 0.5), top=(0.3, 0.6), soft=0.4, opacity=0.6, refl=(0.9, 0.5, 0.2)),
        Patch(density=(0.2, 1.0), strength=(0.2, 1.0), soft=0.3, opacity=0.9, emit=(0.1, 0.2, 0.4)),
    )
)


@pytest.mark.parametrize(
    ("constant", "cross_bar"), [("modu", CrossBar(modu=Field.STRENGTH)), ("opac", CrossBar(opac=Field.GRID_I))]
)
def test_an_opacity_that_is_the_same_everywhere_weights_colours_whatever_indexes_it(
    constant: str, cross_bar: CrossBar
) -> None:
    scene = scene_of(OBLIQUE, Reconstruction(slab=2.0))
    by_density = msgspec.structs.replace(scene.tables, **{constant: ScalarTable(((0.0, 0.5), (1.0, 0.5)))})
    other = "opac" if constant == "modu" else "modu"
    tables = msgspec.structs.replace(by_density, **{other: ScalarTable(((0.0, 0.0), (0.6, 1.0)))})
    cross_bar = msgspec.structs.replace(cross_bar, **{other: Field.DENSITY})
    scene = msgspec.structs.replace(scene, tables=tables, cross_bar=cross_bar)
    assert difference(scene, CUBIC, exact=False).max() <= ONE_LEVEL


@pytest.mark.parametrize("slab", [0.25, 1.0])
def test_opacities_near_1_are_what_they_are_whatever_gives_them(slab: float) -> None:
    scene = scene_of(OBLIQUE, Reconstruction(slab=slab), cross_bar=CrossBar(modu=Field.GRID_I))
    steep = ScalarTable(((0.0, 0.9), (0.5, 0.998), (1.0, 1.0)))
    opaque = ScalarTable(((0.0, 0.0), (0.2, 1.0)))
    scene = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=opaque, modu=steep))
    assert difference(scene, CUBIC, exact=False).max() <= 0.1 * ONE_LEVEL


def test_patches_are_those_of_the_strength_in_the_middle_of_a_slab() -> None:
    off = difference(scene_of(OBLIQUE, plane=PLANE), SKEWED, exact=False)
    assert (off > ONE_LEVEL).double().mean() <= FEW_TIES  # where a byte is a hair from the next one


@pytest.mark.parametrize("unit", [1e-20, 1e19, 3e24])
def test_the_unit_of_length_changes_nothing(unit: float) -> None:
    """A cluster of galaxies in centimetres is lit as a skull in millimetres is."""
    cross_bar = CrossBar(refl=Field.STRENGTH)
    scene = scene_of(OBLIQUE, cross_bar=cross_bar, light=Light(silhouettes=0.8, shadows=0.5))
    values, scale = shells(SIZE), QUANTISATION.strength_scale
    geometry = Geometry(SKEWED.dims, matrices.times(SKEWED.index_to_physical, unit))
    quantisation = msgspec.structs.replace(QUANTISATION, strength_scale=scale * unit)
    drawn, expected = rendered(values, geometry, scene, Step.G, quantisation), rendered(values, SKEWED, scene, Step.G)
    off = (drawn - expected).abs().amax(dim=-1)
    assert (off <= ONE_LEVEL).double().mean() >= 1 - FEW_TIES  # where a byte is a hair from the next one


def test_bounds_cut_between_voxels_and_look_beyond() -> None:
    scene = scene_of(OBLIQUE, bounds=Bounds(low=(3, 0, 2), high=(-1, 9, 11)))
    assert difference(scene, SKEWED, exact=False).max() <= ONE_LEVEL


def test_what_has_no_data_is_left_out() -> None:
    values = shells(SIZE)
    values[4:9, 3:7, 5:] = torch.nan
    assert difference(scene_of(OBLIQUE), CUBIC, exact=False, values=values).max() <= ONE_LEVEL


def test_densities_between_others_that_are_seen_are_hidden() -> None:
    """And a highlight as sharp as there is."""
    scene = scene_of(OBLIQUE)
    peaks = ScalarTable(points=((0.3, 0.0), (0.35, 0.4), (0.4, 0.0), (0.6, 0.0), (0.7, 0.9), (0.8, 0.0)))
    tables = msgspec.structs.replace(scene.tables, opac=peaks)
    shading = msgspec.structs.replace(scene.shading, specular=True, specular_power=500.0)
    scene = msgspec.structs.replace(scene, tables=tables, shading=shading)
    assert difference(scene, SKEWED, exact=False).max() <= ONE_LEVEL


@pytest.mark.parametrize("changes", [{"depth_cue": 0.8}, {"silhouettes": 0.9}, {"depth_cue": 1.0, "silhouettes": 1.0}])
def test_what_is_far_or_turns_away_is_darker(changes: dict[str, float]) -> None:
    plain = scene_of(OBLIQUE)
    scene = msgspec.structs.replace(plain, light=msgspec.structs.replace(plain.light, **changes))
    assert difference(scene, SKEWED, exact=False).max() <= ONE_LEVEL
    drawn, before = (rendered(shells(SIZE), SKEWED, one, Step.G) for one in (scene, plain))
    assert torch.equal(drawn[..., 3], before[..., 3])
    assert (drawn[..., :3] <= before[..., :3]).all() and drawn[..., :3].sum() < 0.9 * before[..., :3].sum()
    assert torch.equal(*(rendered(shells(SIZE), SKEWED, one, Step.F) for one in (scene, plain)))


BY_GRID, BY_SCREEN = CrossBar(modu=Field.GRID_J), CrossBar(modu=Field.SCREEN_Y)


@pytest.mark.parametrize("geometry", [CUBIC, SKEWED])
@pytest.mark.parametrize(
    ("changes", "others"),
    [
        ({"shadows": 1.0, "direction": (1.0, 0.4, -0.2)}, {"cross_bar": BY_SCREEN}),
        (
            {"shadows": 0.7, "direction": (0.2, -1.0, 0.5), "fixed_to": "grid"},
            {"cross_bar": CrossBar(modu=Field.GRID_J)},
        ),
        ({"occlusion": 1.0}, {}),
        ({"shadows": 0.8, "occlusion": 0.5}, {"plane": PLANE}),
        ({"shadows": 0.5, "occlusion": 0.8, "silhouettes": 0.5}, {"bounds": Bounds(low=(3, 0, 2), high=(-1, 9, 11))}),
    ],
)
def test_the_volume_dims_its_own_light(geometry: Geometry, changes: dict[str, Any], others: dict[str, Any]) -> None:
    plain = msgspec.structs.replace(scene_of(OBLIQUE), **others)
    dark = {key: 0.0 for key in ("shadows", "occlusion", "silhouettes")}
    scene = msgspec.structs.replace(plain, light=msgspec.structs.replace(plain.light, **changes))
    plain = msgspec.structs.replace(plain, light=msgspec.structs.replace(scene.light, **dark))
    values = shells(SIZE)
    values[4:6, 3:7, 9:] = torch.nan
    off = difference(scene, geometry, exact=False, values=values)
    assert (off > ONE_LEVEL).double().mean() <= FEW_TIES
    drawn, before = (rendered(values, geometry, one, Step.G) for one in (scene, plain))
    assert torch.equal(drawn[..., 3], before[..., 3])
    assert (drawn[..., :3] <= before[..., :3]).all() and drawn[..., :3].sum() < before[..., :3].sum()


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_both_orders_are_one(order: Order) -> None:
    scene, values = scene_of(OBLIQUE), shells(SIZE)
    drawn = rendered(values, CUBIC, msgspec.structs.replace(scene, order=order), Step.G)
    assert torch.equal(drawn, rendered(values, CUBIC, scene, Step.G))


def test_a_thin_surface_of_steep_tables_has_no_holes() -> None:
    """Its densities lie between those of two neighbouring planes, and of two neighbouring voxels."""
    k, j, i = torch.meshgrid(*(torch.arange(SIZE, dtype=torch.float64),) * 3, indexing="ij")
    values = 30 * ((i - 6.5) ** 2 + (j - 6.5) ** 2 + (k - 6.5) ** 2).sqrt()
    scene = scene_of(msgspec.structs.replace(OBLIQUE, zoom=3.0))
    peak = ScalarTable(points=((0.46, 0.0), (0.465, 1.0), (0.475, 1.0), (0.48, 0.0)))
    scene = msgspec.structs.replace(
        scene, tables=msgspec.structs.replace(scene.tables, opac=peak, modu=ScalarTable(points=((0.0, 1.0),)))
    )
    alpha = rendered(values, CUBIC, scene, Step.G)[..., 3]
    middle = (PIXELS - 1) / 2
    y, x = torch.meshgrid(torch.arange(PIXELS) - middle, torch.arange(PIXELS) - middle, indexing="ij")
    distance = (x**2 + y**2).sqrt() / 3.0
    assert alpha[distance < 3.5].min() > 0.3
    assert alpha[distance > 5.0].max() == 0.0


@pytest.mark.parametrize(
    ("kernel", "slab", "within"),
    [
        (SlabKernel.BALANCED, 0.5, UNEVEN_BALL_OVERSHOT),
        (SlabKernel.BALANCED, 1.0, UNEVEN_BALL_OVERSHOT),
        (SlabKernel.KAISER_BESSEL, 1.0, UNEVEN_BALL),
    ],
)
def test_a_uniform_ball_is_as_bright_from_every_side(kernel: SlabKernel, slab: float, within: float) -> None:
    """Its mean over the image; fog, so that every voxel counts as much."""
    k, j, i = torch.meshgrid(*(torch.arange(SIZE, dtype=torch.float64),) * 3, indexing="ij")
    distance = ((i - 6.5) ** 2 + (j - 6.5) ** 2 + (k - 6.5) ** 2).sqrt()
    values = 255 * torch.sigmoid((4.5 - distance) / 0.4)
    fog = ScalarTable(points=((0.0, 0.0), (1.0, 0.02)))
    directions = torch.randn((25, 4), generator=torch.Generator().manual_seed(3), dtype=torch.float64).tolist()
    means = []
    for x, y, z, w in directions:
        scene = scene_of(View(rotation=(x, y, z, w), zoom=2.3), Reconstruction(slab=slab, slab_kernel=kernel))
        tables = msgspec.structs.replace(scene.tables, opac=fog, modu=ScalarTable(points=((0.0, 1.0),)))
        drawn = rendered(values, CUBIC, msgspec.structs.replace(scene, tables=tables), Step.G)
        means.append(float(drawn[..., 3].double().mean()))
    assert max(means) - min(means) <= within * max(means)


def test_planes_do_not_show_as_rings_on_a_thin_skin_of_steep_tables() -> None:
    """Gradients turn around within a slab, and what faces the light takes a share of it that changes evenly."""
    k, j, i = torch.meshgrid(*(torch.arange(2 * SIZE, dtype=torch.float64),) * 3, indexing="ij")
    middle = SIZE - 0.5
    away = ((i - middle) ** 2 + (j - middle) ** 2 + (k - middle) ** 2).sqrt() - 0.8 * SIZE
    values = 134 * torch.exp(-((away / 1.9) ** 2))
    steep = ScalarTable(points=((0.38, 0.0), (0.384, 0.2), (0.51, 0.85)))
    scene = scene_of(View(zoom=4.0), light=Light(direction=(0.35, 0.45, 1.0)))
    scene = msgspec.structs.replace(
        scene, tables=msgspec.structs.replace(scene.tables, opac=steep, modu=ScalarTable(points=((0.0, 1.0),)))
    )
    drawn = rendered(values, Geometry((2 * SIZE,) * 3), scene, Step.G)[..., :3].double().mean(dim=-1)
    inner = drawn[1:-1, 1:-1]
    laplacian = drawn[:-2, 1:-1] + drawn[2:, 1:-1] + drawn[1:-1, :-2] + drawn[1:-1, 2:] - 4 * inner
    assert 255 * laplacian.abs().mean() <= MEAN_RING
