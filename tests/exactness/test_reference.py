"""The reference itself: the paper's formulas on numbers worked out by hand, and what quantisation costs."""

import functools

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from reference import combining, render, voxel_packets
from support.scenes.arbitrary import plain_scene, quaternion_to, situations, turns
from support.scenes.phantoms import QUANTISATION, shaded_scene, shells
from support.scenes.rendering import TableWeights, rendered
from tolerances import (
    MISMATCHED_AXIS_ALIGNED,
    MISMATCHED_OBLIQUE,
    ONE_LEVEL,
    ROUNDING,
    SAME_NUMBERS,
)
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Kernel, Order, Reconstruction, Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.levels import Thinning, own_resolution
from volsplat.protocol.rules.refinement import PAPER_STEPS

SIZE = 40
GEOMETRY = Geometry((SIZE, SIZE, SIZE), ((0.8, 0.0, 0.0), (0.0, 0.9, 0.0), (0.0, 0.0, 1.2)))
ZOOMS = (1.0, 1.005, 1.73, 2.01)
MISMATCHES_BY_VIEW = [
    ((0.1, 0.2, 0.3, 0.9), MISMATCHED_OBLIQUE),
    (quaternion_to((1.0, 1.0, 1.0)), MISMATCHED_OBLIQUE),
    ((0.0, 0.0, 0.0, 1.0), MISMATCHED_AXIS_ALIGNED),
    ((0.5, 0.5, 0.5, 0.5), MISMATCHED_AXIS_ALIGNED),
]


@functools.cache
def packets() -> Tensor:
    return voxel_packets.pack(shells(SIZE), GEOMETRY, QUANTISATION)


@functools.cache
def without_quantisation(rotation: tuple[float, float, float, float], zoom: float, order: Order) -> Tensor:
    """The reference's image, for two tests, one beside the other so that one process has them both."""
    return render.render(packets(), GEOMETRY, QUANTISATION, shown(rotation, zoom, order), Step.F, exact=True)


def shown(rotation: tuple[float, float, float, float], zoom: float, order: Order) -> Scene:
    return shaded_scene(View(rotation=rotation, zoom=zoom), (96, 96), order)


def with_order(scene: Scene, order: Order) -> Scene:
    return msgspec.structs.replace(scene, order=order)


def test_two_samples_combine_as_the_paper_writes() -> None:
    near, far = torch.tensor([[1.0, 0.0, 0.5]]).double(), torch.tensor([[0.0, 1.0, 1.0]]).double()
    near_opacity, far_opacity = torch.tensor([0.25]).double(), torch.tensor([0.5]).double()
    empty = torch.zeros((1, 4), dtype=torch.float64)
    expected = [0.25, 0.75 * 0.5, 0.25 * 0.5 + 0.75 * 0.5, 0.25 + 0.75 * 0.5]
    behind = combining.back_to_front(empty, far_opacity, far)
    assert combining.back_to_front(behind, near_opacity, near)[0].tolist() == expected
    before = combining.front_to_back(empty, near_opacity, near)
    assert combining.front_to_back(before, far_opacity, far)[0].tolist() == expected


def test_a_weight_multiplies_the_opacity_once_and_never_beyond_1() -> None:
    weights = torch.tensor([0.0, 0.5, 1.0, 3.0], dtype=torch.float64)
    assert combining.weighted(weights, torch.full_like(weights, 0.5)).tolist() == [0, 0.25, 0.5, 1]


def test_front_to_back_a_pixel_is_frozen_from_its_alpha_on() -> None:
    buffer = torch.tensor([[0.1, 0.2, 0.3, 1 - 1 / 1024], [0.1, 0.2, 0.3, 1 - 1.01 / 1024]], dtype=torch.float64)
    white, opaque = torch.ones((2, 3), dtype=torch.float64), torch.ones(2, dtype=torch.float64)
    after = combining.front_to_back(buffer, opaque, white)
    assert torch.equal(after[0], buffer[0])
    assert float(after[1, 3]) == pytest.approx(1, abs=ROUNDING)


@given(st.integers(0, 2**32), st.integers(0, 300), st.sampled_from(TRAVERSAL_ORDERS))
def test_combining_all_pixels_at_once_is_combining_sample_by_sample(seed: int, count: int, order: Order) -> None:
    generator = torch.Generator().manual_seed(seed)
    pixel = torch.randint(0, 7, (count,), generator=generator)
    opacity = torch.rand(count, generator=generator, dtype=torch.float64)
    colour = torch.rand((count, 3), generator=generator, dtype=torch.float64)
    at_once = torch.zeros((7, 4), dtype=torch.float64)
    if count:
        combining.combine(order, at_once, pixel, opacity, colour)
    rule = combining.back_to_front if order == Order.BACK_TO_FRONT else combining.front_to_back
    one_by_one = torch.zeros((7, 4), dtype=torch.float64)
    for n in range(count):
        here = pixel[n : n + 1]
        one_by_one[here] = rule(one_by_one[here], opacity[n : n + 1], colour[n : n + 1])
    assert torch.equal(at_once, one_by_one)


@given(turns, st.sampled_from(PAPER_STEPS), st.sampled_from((0.6, 1.0, 1.73)))
def test_both_orders_of_the_reference_agree(
    rotation: tuple[float, float, float, float], step: Step, zoom: float
) -> None:
    size = 12
    geometry = Geometry((size, size, size))
    scene = shaded_scene(View(rotation=rotation, zoom=zoom), (24, 24))
    voxels = voxel_packets.pack(shells(size), geometry, QUANTISATION)
    one = render.render(voxels, geometry, QUANTISATION, with_order(scene, Order.BACK_TO_FRONT), step, exact=True)
    two = render.render(voxels, geometry, QUANTISATION, with_order(scene, Order.FRONT_TO_BACK), step, exact=True)
    assert (one - two).abs().max() <= ONE_LEVEL


@pytest.mark.parametrize("zoom", ZOOMS)
@pytest.mark.parametrize(("rotation", "allowed"), MISMATCHES_BY_VIEW)
def test_what_is_quantised_on_the_wire_hardly_shows(
    rotation: tuple[float, float, float, float], allowed: float, zoom: float
) -> None:
    exact = without_quantisation(rotation, zoom, Order.BACK_TO_FRONT)
    scene = shown(rotation, zoom, Order.BACK_TO_FRONT)
    wire = render.render(packets(), GEOMETRY, QUANTISATION, scene, Step.F, exact=False)
    off = (exact - wire).abs().amax(dim=2)
    assert (off > ONE_LEVEL).double().mean() <= allowed
    assert exact[..., 3].max() > 0.9


@pytest.mark.parametrize("zoom", ZOOMS)
@pytest.mark.parametrize(("rotation", "allowed"), MISMATCHES_BY_VIEW)
def test_kernels_hardly_differ_from_the_reference_without_quantisation(
    rotation: tuple[float, float, float, float], allowed: float, zoom: float
) -> None:
    for order in TRAVERSAL_ORDERS:
        exact = without_quantisation(rotation, zoom, order)
        image = rendered(shells(SIZE), GEOMETRY, shown(rotation, zoom, order), Step.F)
        off = (exact - image).abs().amax(dim=2)
        assert (off > ONE_LEVEL).double().mean() <= allowed


def test_transparent_samples_and_no_data_leave_the_image_empty() -> None:
    geometry = Geometry((4, 4, 4))
    nothing = torch.full((4, 4, 4), torch.nan, dtype=torch.float64)
    for values in (nothing, torch.zeros_like(nothing)):
        voxels = voxel_packets.pack(values, geometry, QUANTISATION)
        for step in (Step.A, Step.C, Step.F):
            image = render.render(voxels, geometry, QUANTISATION, plain_scene(), step, exact=False)
            assert not image.any()


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("step", [Step.A, Step.C, Step.F])
@pytest.mark.parametrize("zoom", (0.25, 0.7, *ZOOMS, 5.0))
@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0, 1.0), (0.5, 0.5, 0.5, 0.5), (0.1, 0.2, 0.3, 0.9)])
def test_kernels_draw_what_the_reference_draws_from_the_same_packets_and_table(
    rotation: tuple[float, float, float, float], zoom: float, step: Step, order: Order
) -> None:
    size = 18
    geometry = Geometry((size, size, size), GEOMETRY.index_to_physical)
    scene = shaded_scene(View(rotation=rotation, zoom=zoom), (50, 47), order)
    values = shells(size)
    voxels = voxel_packets.pack(values, geometry, QUANTISATION)
    table = TableWeights(scene, geometry, step) if step >= Step.D else None
    expected = render.render(voxels, geometry, QUANTISATION, scene, step, exact=False, weights=table)
    assert (rendered(values, geometry, scene, step) - expected).abs().max() <= ONE_LEVEL


@given(situations(largest=8), st.sampled_from(PAPER_STEPS), st.integers(0, 2**32), st.sampled_from(Kernel))
def test_kernels_and_reference_agree_in_any_view_of_any_grid(
    situation: tuple[Scene, Geometry], step: Step, seed: int, kernel: Kernel
) -> None:
    drawn, geometry = situation
    size = (min(drawn.image.width, 40), min(drawn.image.height, 40))
    view = msgspec.structs.replace(drawn.view, zoom=min(float(drawn.view.zoom), 5.0))
    scene = msgspec.structs.replace(
        shaded_scene(view, size, drawn.order), bounds=drawn.bounds, reconstruction=Reconstruction(kernel=kernel)
    )
    ni, nj, nk = geometry.dims
    values = 255 * torch.rand((nk, nj, ni), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    voxels = voxel_packets.pack(values, geometry, QUANTISATION)
    table = TableWeights(scene, geometry, step) if step >= Step.D else None
    expected = render.render(voxels, geometry, QUANTISATION, scene, step, exact=False, weights=table)
    assert (rendered(values, geometry, scene, step) - expected).abs().max() <= ONE_LEVEL


@given(situations(largest=8), st.sampled_from([(2, 1), (2, 2), (4, 1), (1, 2)]), st.integers(0, 2**32))
def test_kernels_and_reference_agree_where_sheets_and_rows_are_left_out(
    situation: tuple[Scene, Geometry], left: tuple[int, int], seed: int
) -> None:
    drawn, geometry = situation
    size = (min(drawn.image.width, 40), min(drawn.image.height, 40))
    view = msgspec.structs.replace(drawn.view, zoom=min(float(drawn.view.zoom), 5.0))
    scene = msgspec.structs.replace(shaded_scene(view, size, drawn.order), bounds=drawn.bounds)
    ni, nj, nk = geometry.dims
    values = 255 * torch.rand((nk, nj, ni), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    voxels = voxel_packets.pack(values, geometry, QUANTISATION)
    thinned = own_resolution(geometry, Step.F, Thinning(sheets=left[0], rows=left[1]))
    table = TableWeights(scene, geometry, Step.F, thinned)
    expected = render.render(
        voxels, geometry, QUANTISATION, scene, Step.F, exact=False, weights=table, resolution=thinned
    )
    image = rendered(values, geometry, scene, Step.F, resolution=thinned)
    assert (image - expected).abs().max() <= ONE_LEVEL


@pytest.mark.parametrize("opacity", [1e-5, 1e-4, 1e-3, 1e-2])
def test_kernels_and_reference_agree_in_thin_fog(opacity: float) -> None:
    geometry = Geometry((6, 6, 200))
    scene = plain_scene(opacity, view=View(rotation=quaternion_to((0.02, 0.01, 1.0)), zoom=1.73), size=(18, 18))
    values = torch.full((200, 6, 6), 255.0, dtype=torch.float64)
    voxels = voxel_packets.pack(values, geometry, QUANTISATION)
    for step in (Step.A, Step.C, Step.F):
        table = TableWeights(scene, geometry, step) if step >= Step.D else None
        expected = render.render(voxels, geometry, QUANTISATION, scene, step, exact=False, weights=table)
        image = rendered(values, geometry, scene, step)
        assert (image - expected).abs().max() <= SAME_NUMBERS
        exact = render.render(voxels, geometry, QUANTISATION, scene, step, exact=True)
        assert (image - exact).abs().max() <= ONE_LEVEL
