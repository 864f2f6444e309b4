"""The footprint's ellipse and its kernels: the integral, unity over the lattice, and widening below a pixel."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference import mapping
from reference.footprint import footprint_of, integral, projection
from support.scenes.arbitrary import geometries, plain_scene, quaternions
from tolerances import PROFILE, QUADRATURE, ROUNDING, SUM_OVER_PIXELS
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Kernel, Reconstruction, Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.footprint_shape import (
    DEFAULT_RADIUS,
    DOCUMENTED_RIPPLE,
    GAUSSIAN_SIGMA,
    FootprintShape,
    footprint_shape,
)
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.grid_on_screen import grid_on_screen
from volsplat.protocol.rules.refinement import PAPER_STEPS, STEP_RULES
from volsplat.protocol.rules.resolved_view import resolved_zoom

ZOOMS = (0.25, 0.5, 0.77, 1.0, 1.005, 1.73, 2.01, 4.0, 16.0)


def weights(shape: FootprintShape, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    rho = (shape.qxx * x**2 + 2 * shape.qxy * x * y + shape.qyy * y**2).clamp(min=0).sqrt()
    return shape.amplitude * projection(shape.kernel, shape.radius, rho)


def scene_of(kernel: Kernel, rotation: tuple[float, float, float, float], zoom: float) -> Scene:
    return plain_scene(view=View(rotation=rotation, zoom=zoom), reconstruction=Reconstruction(kernel=kernel))


@pytest.mark.parametrize("kernel", Kernel)
def test_projection_integrates_to_one_over_the_plane(kernel: Kernel) -> None:
    radius = DEFAULT_RADIUS[kernel]
    whole = integral(
        lambda r: 2 * math.pi * r * projection(kernel, radius, r), torch.tensor([radius], dtype=torch.float64)
    )
    assert float(whole) == pytest.approx(1, abs=QUADRATURE)


@pytest.mark.parametrize("radius", [1.0, 2.0, 2.5, 4.0])
def test_projection_of_the_gaussian_is_a_gaussian_times_an_error_function(radius: float) -> None:
    s = GAUSSIAN_SIGMA
    rho = torch.linspace(0, radius, 101, dtype=torch.float64)
    chord = (radius**2 - rho**2).clamp(min=0).sqrt()
    whole = math.erf(radius / (s * math.sqrt(2))) - math.sqrt(2 / math.pi) * radius / s * math.exp(
        -(radius**2) / (2 * s**2)
    )
    expected = torch.exp(-(rho**2) / (2 * s**2)) * torch.erf(chord / (s * math.sqrt(2))) / (2 * math.pi * s**2 * whole)
    assert (projection(Kernel.GAUSSIAN, radius, rho) - expected).abs().max() <= PROFILE


@pytest.mark.parametrize("radius", [1.0, 2.0, 3.0])
def test_projection_of_the_cone_is_its_closed_form(radius: float) -> None:
    rho = torch.linspace(0.001, radius, 101, dtype=torch.float64)
    chord = (radius**2 - rho**2).clamp(min=0).sqrt()
    through = chord * radius - rho**2 * torch.log((radius + chord) / rho)
    expected = through / radius / (math.pi * radius**3 / 3)
    assert (projection(Kernel.CONE, radius, rho) - expected).abs().max() <= PROFILE


@pytest.mark.parametrize("kernel", Kernel)
def test_footprint_reaches_zero_at_its_rim_and_falls_outwards(kernel: Kernel) -> None:
    radius = DEFAULT_RADIUS[kernel]
    profile = projection(kernel, radius, torch.linspace(0, radius * 1.2, 200, dtype=torch.float64))
    assert (profile.diff() <= 0).all()
    assert projection(kernel, radius, torch.tensor(radius, dtype=torch.float64)) == 0


@given(geometries(), quaternions, st.sampled_from(ZOOMS), st.sampled_from(Kernel), st.sampled_from(PAPER_STEPS))
def test_ellipse_is_that_of_an_independent_derivation(
    geometry: Geometry, rotation: tuple[float, float, float, float], zoom: float, kernel: Kernel, step: Step
) -> None:
    scene = scene_of(kernel, rotation, zoom)
    stride = STEP_RULES[step].stride
    shape = footprint_shape(grid_on_screen(scene, geometry), stride, scene.reconstruction)
    steps = mapping.steps_on_screen(scene, geometry)
    expected = footprint_of(steps, zoom, stride, scene.reconstruction)
    q = expected.inverse_ellipse
    got = torch.tensor([shape.qxx, shape.qxy, shape.qyy, shape.amplitude, shape.half_width, shape.half_height])
    wanted = torch.tensor([q[0, 0], q[0, 1], q[1, 1], expected.amplitude, *expected.half_size])
    assert torch.allclose(got.double(), wanted.double(), rtol=1e-6, atol=ROUNDING)


@given(geometries(), quaternions, st.sampled_from((0.25, 0.77, 1.0, 2.01, 4.0)), st.sampled_from(Kernel))
def test_weights_over_all_pixels_sum_to_a_voxel_s_share(
    geometry: Geometry, rotation: tuple[float, float, float, float], zoom: float, kernel: Kernel
) -> None:
    """The mean over sub-pixel shifts of the sum over pixels is the integral: (zoom * stride)^2."""
    scene = scene_of(kernel, rotation, zoom)
    for stride in (1, 4):
        shape = footprint_shape(grid_on_screen(scene, geometry), stride, scene.reconstruction)
        fine_x, fine_y = shape.half_width / 256, shape.half_height / 256
        x = torch.arange(-256, 257, dtype=torch.float64) * fine_x
        y = torch.arange(-256, 257, dtype=torch.float64) * fine_y
        total = float(weights(shape, x[None, :], y[:, None]).sum()) * fine_x * fine_y
        assert total == pytest.approx((zoom * stride) ** 2, rel=SUM_OVER_PIXELS)


def sums_over_a_layer(
    scene: Scene, geometry: Geometry, stride: int, shape: FootprintShape, shifts: torch.Tensor
) -> torch.Tensor:
    """The sum of the weights of an endless layer (the sheet in this view) at pixels (n, 2) of any sub-pixel shift.

    In reference spacings of thickness: 1 where the layer's weights are just the path through it.
    """
    pixels_per_index = torch.tensor(grid_on_screen(scene, geometry).pixels_per_index, dtype=torch.float64)
    _, row, sample = plan_frame(scene, geometry, Step.D).traversal.axes
    steps = pixels_per_index[:2, [row, sample]] * stride
    reach = torch.tensor([shape.half_width, shape.half_height], dtype=torch.float64).norm()
    back = torch.linalg.inv(steps)
    counts = [int(reach * back[n].norm()) + 2 for n in range(2)]
    lattice = torch.cartesian_prod(*(torch.arange(-n, n + 1, dtype=torch.float64) for n in counts)) @ steps.T
    off = shifts[:, None, :] - lattice[None]
    total = weights(shape, off[..., 0], off[..., 1]).sum(dim=1)
    volume = abs(float(torch.linalg.det(pixels_per_index)))
    path = volume / (abs(float(torch.linalg.det(steps))) / stride**2) / resolved_zoom(scene, geometry)
    return total / path


@pytest.mark.parametrize("kernel", Kernel)
@given(
    geometry=geometries(),
    rotation=quaternions,
    zoom=st.one_of(st.sampled_from(ZOOMS), st.floats(0.25, 16)),
    shift=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_weights_that_cover_a_pixel_sum_to_thickness(
    kernel: Kernel,
    geometry: Geometry,
    rotation: tuple[float, float, float, float],
    zoom: float,
    shift: tuple[float, float],
) -> None:
    scene = scene_of(kernel, rotation, zoom)
    grid = grid_on_screen(scene, geometry)
    shape = footprint_shape(grid, 1, scene.reconstruction)
    # Shifts over the lattice's own cell, where the ripple has its crests and troughs, and over the pixel.
    _, row, sample = plan_frame(scene, geometry, Step.D).traversal.axes
    steps = torch.tensor(grid.pixels_per_index, dtype=torch.float64)[:2, [row, sample]]
    parts = torch.cartesian_prod(*(torch.arange(4, dtype=torch.float64) / 4,) * 2) @ steps.T
    sums = sums_over_a_layer(scene, geometry, 1, shape, parts + torch.tensor(shift, dtype=torch.float64))
    assert (sums - 1).abs().max() <= DOCUMENTED_RIPPLE[kernel]


def test_the_default_kernel_sums_to_thickness_within_one_percent() -> None:
    assert DOCUMENTED_RIPPLE[Reconstruction().kernel] <= 0.01


@given(geometries(), quaternions, st.sampled_from((1.0, 2.01, 4.0)))
def test_with_strides_weights_sum_to_thickness_over_the_stride(
    geometry: Geometry, rotation: tuple[float, float, float, float], zoom: float
) -> None:
    scene = scene_of(Kernel.GAUSSIAN, rotation, zoom)
    for stride in (2, 4):
        shape = footprint_shape(grid_on_screen(scene, geometry), stride, scene.reconstruction)
        sums = sums_over_a_layer(scene, geometry, stride, shape, torch.zeros((1, 2)).double())
        # A layer of stride s is s voxels thick and its weights count it in s reference spacings.
        assert float(sums) == pytest.approx(1, abs=DOCUMENTED_RIPPLE[Kernel.GAUSSIAN])


@pytest.mark.parametrize("zoom", [0.05, 0.25, 0.5, 0.99])
def test_below_one_pixel_a_voxel_the_footprint_is_widened_to_the_pixel(zoom: float) -> None:
    scene = scene_of(Kernel.GAUSSIAN, (0.1, 0.2, 0.3, 0.9), zoom)
    shape = footprint_shape(grid_on_screen(scene, Geometry((4, 4, 4))), 1, scene.reconstruction)
    assert (shape.qxx, shape.qxy, shape.qyy) == pytest.approx((1, 0, 1), abs=ROUNDING)
    assert shape.half_width == pytest.approx(shape.radius, abs=ROUNDING)
    assert shape.amplitude == pytest.approx(zoom**2, rel=ROUNDING)


def test_only_the_narrow_axis_is_widened() -> None:
    geometry = Geometry((4, 4, 4), ((1.0, 0.0, 0.0), (0.0, 8.0, 0.0), (0.0, 0.0, 1.0)))
    scene = scene_of(Kernel.GAUSSIAN, (0.0, 0.0, 0.0, 1.0), 1.0)  # 1/2 x 4 x 1/2 pixels a voxel
    shape = footprint_shape(grid_on_screen(scene, geometry), 1, scene.reconstruction)
    assert (shape.qxx, shape.qxy, shape.qyy) == pytest.approx((1, 0, 1 / 16), abs=ROUNDING)
    assert shape.amplitude == pytest.approx(1 / 4, rel=ROUNDING)


@given(geometries(), quaternions, st.floats(0.25, 16))
def test_footprint_does_not_change_with_handedness(
    geometry: Geometry, rotation: tuple[float, float, float, float], zoom: float
) -> None:
    m = geometry.index_to_physical
    mirrored = Geometry(geometry.dims, ((-m[0][0], m[0][1], m[0][2]), (-m[1][0], *m[1][1:]), (-m[2][0], *m[2][1:])))
    scene = scene_of(Kernel.GAUSSIAN, rotation, zoom)
    one = footprint_shape(grid_on_screen(scene, geometry), 1, scene.reconstruction)
    two = footprint_shape(grid_on_screen(scene, mirrored), 1, scene.reconstruction)
    assert one.qxx == pytest.approx(two.qxx, rel=ROUNDING)
    assert (one.qxy, one.qyy) == pytest.approx((two.qxy, two.qyy), rel=ROUNDING)


@given(quaternions, st.floats(0.25, 16), st.sampled_from([1.0, 0.5, 3.0]))
def test_with_equal_spacings_the_footprint_is_exactly_the_same_from_every_side(
    rotation: tuple[float, float, float, float], zoom: float, spacing: float
) -> None:
    matrix = ((spacing, 0.0, 0.0), (0.0, spacing, 0.0), (0.0, 0.0, spacing))
    geometry = Geometry(dims=(5, 6, 7), index_to_physical=matrix)
    turned, straight = (
        footprint_shape(grid_on_screen(plain_scene(view=View(rotation=r, zoom=zoom)), geometry), 1, Reconstruction())
        for r in (rotation, (0.0, 0.0, 0.0, 1.0))
    )
    assert turned == straight
