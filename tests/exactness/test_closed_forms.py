"""Pictures whose pixels are known in closed form: no reference and no footprint table has a say here."""

import itertools
import math

import pytest
import torch
from torch import Tensor

from support.scenes.arbitrary import directions, plain_scene, quaternion_to
from support.scenes.rays import MATRICES, OBLIQUE, SQUARE, constant, crossing, pixels_per_index, rays
from support.scenes.rendering import rendered
from tolerances import (
    BLOCKY_SIDES,
    FOG,
    ONE_LEVEL,
    OPACITY_CODE,
    STRIDES,
)
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Order, Reconstruction, Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Vector, rotation_from_quaternion
from volsplat.protocol.rules.footprint_shape import GAUSSIAN_SIGMA
from volsplat.protocol.rules.frame_plan import CELLS_IN_A_SHEET

TWENTY_SIDES = directions(20)


# One voxel


def kernel_along_rays(geometry: Geometry, scene: Scene, radius: float) -> Tensor:
    """The weights (H, W) of a voxel in the middle of the image: the 3-D Gaussian summed along each pixel's ray.

    Straight from the definition: distance in voxels, cut at `radius` in 3-D, of unit integral, times the voxel's
    volume divided by the reference spacing.
    """
    start, ray = rays(geometry, scene)
    start = start - (torch.tensor(geometry.dims).double() - 1) / 2
    # The ray's part in the ball: a quadratic equation for the depth.
    a, b = (ray**2).sum(), (start * ray).sum(-1)
    c = (start**2).sum(-1) - radius**2
    root = (b**2 - a * c).clamp(min=0).sqrt()
    depths = torch.linspace(-1, 1, 401, dtype=torch.float64)
    depth = (-b[..., None] + depths * root[..., None]) / a
    square = (start**2).sum(-1)[..., None] + depth * (2 * b[..., None] + depth * a)
    sums = torch.trapezoid(torch.exp(-square / (2 * GAUSSIAN_SIGMA**2)), depth, dim=-1)
    s = GAUSSIAN_SIGMA
    ball = (2 * math.pi) ** 1.5 * s**3 * math.erf(radius / (s * math.sqrt(2))) - 4 * math.pi * s**2 * radius * math.exp(
        -(radius**2) / (2 * s**2)
    )
    zoom = scene.view.zoom
    assert zoom != "fit"
    weights: Tensor = sums / ball * zoom**2 / torch.linalg.det(pixels_per_index(geometry, scene)).abs()
    return weights


def one_voxel(dims: tuple[int, int, int] = (5, 5, 5)) -> Tensor:
    values = constant(dims, 0.0)
    values[dims[2] // 2, dims[1] // 2, dims[0] // 2] = 255.0
    return values


@pytest.mark.parametrize("rotation", [SQUARE, OBLIQUE])
@pytest.mark.parametrize("zoom", [3.0, 4.6, 7.3, 11.0, 16.0])
@pytest.mark.parametrize("matrix", MATRICES)
def test_one_voxel_is_its_kernel_s_projection(
    matrix: str, zoom: float, rotation: tuple[float, float, float, float]
) -> None:
    geometry = Geometry((5, 5, 5), MATRICES[matrix])
    scene = plain_scene(0.8, (1.0, 0.4, 0.2), View(rotation=rotation, zoom=zoom), (49, 41))
    weights = kernel_along_rays(geometry, scene, radius=2.0)
    alpha = (0.8 * weights).clamp(max=1)
    expected = alpha[..., None] * torch.tensor([1.0, 0.4, 0.2, 1.0], dtype=torch.float64)
    image = rendered(one_voxel(), geometry, scene, Step.D)
    assert expected.max() > 0.1
    assert (image - expected).abs().max() <= ONE_LEVEL


@pytest.mark.parametrize("radius", [1.5, 2.0, 2.5])
@pytest.mark.parametrize("zoom", [1.0, 1.73])
def test_one_small_voxel_is_its_kernel_s_projection_between_the_pixels(zoom: float, radius: float) -> None:
    geometry = Geometry((5, 5, 5))
    for size in ((9, 9), (10, 9), (10, 10)):  # the voxel on a pixel, and between two and four
        scene = plain_scene(
            view=View(rotation=OBLIQUE, zoom=zoom), size=size, reconstruction=Reconstruction(radius=radius)
        )
        image = rendered(one_voxel(), geometry, scene, Step.D)
        assert (image[..., 3] - kernel_along_rays(geometry, scene, radius)).abs().max() <= ONE_LEVEL


@pytest.mark.parametrize("zoom", [0.25, 0.5, 0.9])
def test_one_voxel_below_a_pixel_keeps_its_volume_and_is_as_wide_as_a_pixel(zoom: float) -> None:
    geometry = Geometry((5, 5, 5))
    scene = plain_scene(view=View(rotation=OBLIQUE, zoom=zoom), size=(9, 9))
    at_one = plain_scene(view=View(rotation=OBLIQUE, zoom=1.0), size=(9, 9))
    image = rendered(one_voxel(), geometry, scene, Step.D)
    assert (image[..., 3] - zoom**2 * kernel_along_rays(geometry, at_one, 2.0)).abs().max() <= ONE_LEVEL


# Slabs


SLAB = Geometry((110, 110, 11))  # so wide that even rays almost along it enter and leave well away from corners


@pytest.mark.parametrize("toward", TWENTY_SIDES)
def test_a_uniform_slab_is_its_formula_from_20_sides(toward: Vector) -> None:
    opacity = 0.003
    scene = plain_scene(opacity, (0.2, 0.6, 1.0), View(rotation=quaternion_to(toward), zoom=1.31), (40, 40))
    clear, path = crossing(SLAB, scene, margin=2.0)
    assert clear.any()
    alpha = 1 - (1 - opacity) ** path
    expected = alpha[..., None] * torch.tensor([0.2, 0.6, 1.0, 1.0], dtype=torch.float64)
    image = rendered(constant(SLAB.dims), SLAB, scene, Step.D)
    assert (image - expected)[clear].abs().max() <= ONE_LEVEL


@pytest.mark.parametrize("matrix", MATRICES)
@pytest.mark.parametrize("toward", TWENTY_SIDES[::4])
def test_a_uniform_slab_is_its_formula_whatever_its_matrix(matrix: str, toward: Vector) -> None:
    opacity = 0.005
    geometry = Geometry((40, 40, 8), MATRICES[matrix])
    along = rotation_from_quaternion(quaternion_to(toward))  # any turn of a view near the slab's normal
    tilted = (0.3 * along[0][0], 0.3 * along[1][1], 1.0)
    scene = plain_scene(opacity, view=View(rotation=quaternion_to(tilted), zoom=1.5), size=(80, 80))
    clear, path = crossing(geometry, scene, margin=2.0)
    assert clear.any()
    image = rendered(constant(geometry.dims), geometry, scene, Step.D)
    assert (image[..., 3] - (1 - (1 - opacity) ** path))[clear].abs().max() <= ONE_LEVEL


def thin_on_the_sheet_axis(toward: Vector) -> Geometry:
    sizes = [40, 40, 40]
    sizes[max(range(3), key=lambda axis: abs(toward[axis]))] = 10
    return Geometry((sizes[0], sizes[1], sizes[2]))


@pytest.mark.parametrize("opacity", [0.02, 0.3])
@pytest.mark.parametrize("toward", TWENTY_SIDES)
def test_a_b_and_c_show_a_slab_equally_opaque_and_as_its_formula(toward: Vector, opacity: float) -> None:
    geometry = thin_on_the_sheet_axis(toward)
    scene = plain_scene(opacity, view=View(rotation=quaternion_to(toward), zoom=2.3), size=(120, 120))
    clear, path = crossing(geometry, scene, margin=4.0)
    assert clear.any()
    expected = 1 - (1 - opacity) ** path
    for step in (Step.A, Step.B, Step.C):
        image = rendered(constant(geometry.dims), geometry, scene, step)
        assert (image[..., 3] - expected)[clear].abs().max() <= OPACITY_CODE


@pytest.mark.parametrize("toward", TWENTY_SIDES)
def test_strides_keep_opacity_from_every_side_of_a_thin_slab(toward: Vector) -> None:
    """Here rays may enter and leave through any face, across the steps of a blocky sheet."""
    geometry = Geometry((120, 120, 12))
    scene = plain_scene(BLOCKY_SIDES, view=View(rotation=quaternion_to(toward), zoom=2.3), size=(50, 50))
    clear, _ = crossing(geometry, scene, margin=2.0)
    assert clear.any()
    images = [rendered(constant(geometry.dims), geometry, scene, step) for step in (Step.A, Step.B, Step.C)]
    for one, two in itertools.combinations(images, 2):
        assert (one - two)[clear].abs().max() <= STRIDES


@pytest.mark.parametrize("opacity", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("step", [Step.A, Step.C, Step.F])
@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_thin_fog_is_not_lost(opacity: float, step: Step, order: Order) -> None:
    geometry = Geometry((24, 24, 64))
    view = View(rotation=quaternion_to((0.05, 0.08, 1.0)), zoom=2.0)
    scene = plain_scene(opacity, view=view, size=(40, 40), order=order)
    clear, path = crossing(geometry, scene, margin=4.0)
    assert clear.any()
    depth = -torch.log1p(-rendered(constant(geometry.dims), geometry, scene, step)[..., 3].double())
    wanted = -math.log1p(-opacity) * path
    assert ((depth - wanted) / wanted)[clear].abs().max() <= FOG


def test_fog_at_the_edge_of_the_code_still_adds_up() -> None:
    """An opacity below half the smallest code is nothing; the smallest itself is summed like any other."""
    geometry = Geometry((16, 16, 256))
    for codes, expected in ((0.4, 0.0), (1.0, CELLS_IN_A_SHEET * 256 / (511 * 2**14))):
        scene = plain_scene(CELLS_IN_A_SHEET * codes / (511 * 2**14), view=View(zoom=2.0), size=(16, 16))
        alpha = rendered(constant(geometry.dims), geometry, scene, Step.C)[8, 8, 3]
        assert float(alpha) == pytest.approx(expected, rel=FOG)
