"""The footprint table: kernels projected, offsets chosen, and unity over views, zooms, shifts and matrices."""

import math
from dataclasses import dataclass

import msgspec
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from torch import Tensor

from reference import footprint as reference
from reference import mapping
from support.scenes.arbitrary import index_to_physical, plain_scene, quaternions
from support.scenes.owned import Drawing, owners
from support.scenes.row_runs import FARTHEST
from support.thoroughness import examples
from tolerances import CONE_TIP, PROJECTION, SUM_OVER_PIXELS, UNITY_ROUNDED_POSITIONS
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Kernel, Order, Reconstruction, Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.footprint_shape import DEFAULT_RADIUS, DOCUMENTED_RIPPLE, FootprintShape, footprint_shape
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, GridOnScreen, grid_on_screen
from volsplat.protocol.rules.levels import Thinning, own_resolution
from volsplat.protocol.rules.packet_layout import OPACITY_SHIFT, OPACITY_UNIT, POSITION_BITS, ROW_RUN
from volsplat.protocol.rules.rounding import HALF_THRESHOLD
from volsplat.protocol.text.errors import BadInput
from volsplat.splat_server import _kernels
from volsplat.splat_server._kernels import BatchMemory, Ellipse, FootprintTable
from volsplat.splat_server.footprint_table import (
    CACHE_BUDGET,
    LARGEST_TABLE,
    footprint_table,
    kernel_projection,
    offset_bits_for,
)
from volsplat.splat_server.pixel_reach import reach_and_cost

KERNELS = list(Kernel)


def shape_of(
    zoom: float, kernel: Kernel = Kernel.GAUSSIAN, matrix: matrices.Matrix = matrices.IDENTITY
) -> FootprintShape:
    scene = plain_scene(view=View(zoom=zoom), reconstruction=Reconstruction(kernel=kernel))
    return footprint_shape(grid_on_screen(scene, Geometry((8, 8, 8), matrix)), 1, scene.reconstruction)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("radius", [1.0, 1.7, 2.0, 4.0])
def test_a_projected_kernel_is_the_integral_of_its_definition(kernel: Kernel, radius: float) -> None:
    rho = torch.linspace(0, radius * 1.1, 200, dtype=torch.float64)
    half_chord = (radius**2 - rho**2).clamp(min=0).sqrt()
    along = reference.integral(
        lambda z: reference.kernel_density(kernel, (rho[:, None] ** 2 + z**2).sqrt().clamp(max=radius), radius),
        half_chord,
    )
    over_space = reference.integral(
        lambda r: 4 * math.pi * r**2 * reference.kernel_density(kernel, r, radius), torch.tensor([radius]).double()
    )
    projection = kernel_projection(kernel, radius)
    found = torch.tensor([projection.at_square(float(r) ** 2) for r in rho], dtype=torch.float64)
    assert (found - 2 * along / over_space).abs().max() <= (CONE_TIP if kernel == Kernel.CONE else PROJECTION)
    assert (found[rho >= radius] == 0).all()


def test_an_unknown_kernel_or_size_is_refused() -> None:
    with pytest.raises(ValueError, match="no kernel is called 'box'"):
        _kernels.KernelProjection("box", 0.0, 2.0)
    with pytest.raises(ValueError, match="radius must be above 0"):
        _kernels.KernelProjection("cone", 0.0, 0.0)
    projection = kernel_projection(Kernel.CONE, 2.0)
    with pytest.raises(ValueError, match="finite size"):
        _kernels.FootprintTable(projection, _kernels.Ellipse(1.0, 1.0, 0.0, 1.0, math.inf, 1.0), 3)
    with pytest.raises(ValueError, match="2\\^0 to 2\\^6"):
        _kernels.FootprintTable(projection, _kernels.Ellipse(1.0, 1.0, 0.0, 1.0, 2.0, 2.0), 7)


shifts = st.floats(0, 1)
MOST_SAMPLES_PER_PIXEL = 200
MOST_SAMPLES = 20_000


@dataclass(frozen=True)
class EndlessSheet:
    """The samples of sheet 0 of an endless grid around a small image."""

    scene: Scene
    geometry: Geometry
    grid: GridOnScreen
    doubled: Tensor  # (n, 3) indices
    thickness: float  # of a sheet of cells along the line of sight, in reference spacings

    @property
    def shape(self) -> FootprintShape:
        return footprint_shape(self.grid, 1, self.scene.reconstruction)

    def positions(self) -> Tensor:
        """(n, 2) exact, in pixels."""
        return mapping.on_screen(self.doubled.double() / 2, self.scene, self.geometry)

    def lattice(self) -> Tensor:
        """(n, 2) in 1/64 pixel, rounded."""
        to_nearest = torch.tensor(HALF_THRESHOLD)
        return torch.stack(
            [mapping.on_lattice(dda, self.doubled, to_nearest) for dda in (self.grid.x, self.grid.y)], dim=1
        )


@st.composite
def endless_sheets(draw: st.DrawFn) -> EndlessSheet:
    """Any matrix, view, zoom, sub-pixel shift and kernel."""
    view = View(rotation=draw(quaternions), zoom=draw(st.floats(0.25, 16)), center=draw(st.tuples(*[shifts] * 3)))
    scene = plain_scene(view=view, size=(5, 4), reconstruction=Reconstruction(kernel=draw(st.sampled_from(KERNELS))))
    geometry = Geometry((1, 1, 1), draw(index_to_physical()))
    grid = grid_on_screen(scene, geometry)
    shape = footprint_shape(grid, 1, scene.reconstruction)
    _, row, sample = plan_frame(scene, geometry, Step.F).traversal.axes
    d = torch.tensor(grid.pixels_per_index, dtype=torch.float64)
    on_screen = d[:2, [row, sample]]
    area = abs(float(torch.linalg.det(on_screen)))
    margin_x, margin_y = shape.half_width + 1, shape.half_height + 1
    assume(area > MOST_SAMPLES_PER_PIXEL**-1 and 2 * max(margin_x, margin_y) + 6 < FARTHEST / 64)
    low = torch.tensor([-margin_x, -margin_y], dtype=torch.float64)
    high = torch.tensor([scene.image.width + margin_x, scene.image.height + margin_y], dtype=torch.float64)
    origin = torch.tensor([grid.x.origin, grid.y.origin], dtype=torch.float64) / FIXED_ONE
    corners = torch.cartesian_prod(torch.stack((low[0], high[0])), torch.stack((low[1], high[1])))
    grid_corners = (corners - origin) @ torch.linalg.inv(on_screen).T
    first, end = grid_corners.min(dim=0).values.floor().long() - 1, grid_corners.max(dim=0).values.ceil().long() + 2
    assume(int((end - first).prod()) < MOST_SAMPLES)
    points = torch.cartesian_prod(*(torch.arange(int(first[n]), int(end[n])) for n in (0, 1)))
    near = ((points.double() @ on_screen.T + origin >= low) & (points.double() @ on_screen.T + origin < high)).all(
        dim=1
    )
    doubled = torch.zeros((int(near.sum()), 3), dtype=torch.int64)
    doubled[:, row], doubled[:, sample] = 2 * points[near, 0], 2 * points[near, 1]
    thickness = abs(float(torch.linalg.det(d))) / area / grid.zoom
    return EndlessSheet(scene, geometry, grid, doubled, thickness)


@settings(max_examples=examples(20))
@given(endless_sheets(), st.data())
def test_the_table_holds_the_footprint_at_each_offset(sheet: EndlessSheet, data: st.DataObject) -> None:
    table = footprint_table(sheet.shape)
    steps = mapping.steps_on_screen(sheet.scene, sheet.geometry)
    expected = reference.footprint_of(steps, sheet.grid.zoom, 1, sheet.scene.reconstruction)
    n = 1 << table.offset_bits
    fx, fy = data.draw(st.integers(0, n - 1)), data.draw(st.integers(0, n - 1))
    left, top, weights = table.weights_at(fx, fy)
    x = torch.arange(left - 1, left + table.width + 1, dtype=torch.float64) - fx / n
    y = torch.arange(top - 1, top + table.height + 1, dtype=torch.float64) - fy / n
    around = expected.weights(x[None, :], y[:, None])
    found = torch.zeros_like(around)
    found[1:-1, 1:-1] = torch.tensor(weights, dtype=torch.float64).reshape(table.height, table.width)
    tolerance = CONE_TIP if sheet.shape.kernel == Kernel.CONE else PROJECTION
    assert (found - around).abs().max() <= tolerance * max(1.0, expected.amplitude)


@pytest.mark.parametrize("zoom", [0.25, 0.9, 1.0, 2.0, 7.3, 16.0])
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_weights_of_a_footprint_sum_to_a_voxels_pixels(zoom: float, kernel: Kernel) -> None:
    table = footprint_table(shape_of(zoom, kernel))
    n = 1 << table.offset_bits
    # Over all offsets the pixels sample the footprint n times finer.
    total = sum(math.fsum(table.weights_at(fx, fy)[2]) for fx in range(n) for fy in range(n)) / n**2
    assert total == pytest.approx(zoom**2, rel=SUM_OVER_PIXELS)


def test_offsets_are_as_fine_as_the_cache_allows() -> None:
    assert shape_of(2.0).half_width == pytest.approx(4.0)
    bits = {zoom: footprint_table(shape_of(zoom)).offset_bits for zoom in (0.25, 1.0, 2.0, 4.0, 16.0, 40.0)}
    assert bits == {0.25: 6, 1.0: 6, 2.0: 6, 4.0: 5, 16.0: 3, 40.0: 3}
    for zoom in bits:
        table = footprint_table(shape_of(zoom))
        assert table.bytes <= (CACHE_BUDGET if zoom <= 16 else LARGEST_TABLE)


def test_a_slanted_flat_footprint_gets_offsets_for_its_narrow_side() -> None:
    across = shape_of(4.0)
    flat = msgspec.structs.replace(across, qxx=0.5, qxy=-0.49, qyy=0.5, half_width=14.2, half_height=14.2)
    assert offset_bits_for(flat) == 6
    assert FootprintTable.bytes_needed(Ellipse(1.0, 0.5, -0.49, 0.5, 14.2, 14.2), 6) > CACHE_BUDGET


@given(st.data(), st.floats(0.25, 16000))
def test_offsets_are_at_least_eight_a_pixel_unless_footprints_are_very_large(data: st.DataObject, width: float) -> None:
    """The map/shade server relies on that (mapshade_server/kernels/closed_tiles.cpp) to tell what is hidden."""
    height = data.draw(st.floats(0.25, 4095 / width))
    qxx, qyy = (2 / width) ** 2, (2 / height) ** 2
    shape = msgspec.structs.replace(shape_of(1.0), qxx=qxx, qxy=0.0, qyy=qyy, half_width=width, half_height=height)
    assert offset_bits_for(shape) >= 3


@pytest.mark.parametrize("zoom", [1.0, 1.7, 2.0, 4.0])
def test_pictures_that_are_seen_in_passing_have_coarser_offsets(zoom: float) -> None:
    """As the page draws while things move: with pixels that are frozen early."""
    scene, geometry = plain_scene(view=View(zoom=zoom)), Geometry((8, 8, 8))
    bits = []
    for thinning in (Thinning(), Thinning(frozen_alpha=0.9)):
        plan = plan_frame(scene, geometry, Step.F, own_resolution(geometry, Step.F, thinning))
        table, _ = reach_and_cost(plan, threads=1)
        assert isinstance(table, FootprintTable)
        bits.append(table.offset_bits)
    finest, passing = bits
    assert 3 <= passing < finest and 2**passing * zoom >= 16
    precise = msgspec.structs.replace(shape_of(zoom), precise=True)
    assert offset_bits_for(precise, in_passing=True) == 6


def test_a_huge_footprint_is_coarse_and_one_beyond_any_image_refused() -> None:
    huge = footprint_table(shape_of(256.0))
    assert huge.offset_bits < 3 and huge.width == 4 * 256
    for length in (100.0, 1000.0):  # the latter beyond what kernels count in
        long: matrices.Matrix = ((length, 0.0, 0.0), (0.0, length, 0.0), (0.0, 0.0, 0.01))
        with pytest.raises(BadInput, match="lower the zoom, or correct the volume's spacing"):
            footprint_table(shape_of(256.0, matrix=long))


@settings(max_examples=examples(25))
@given(endless_sheets())
def test_the_weights_over_a_pixel_sum_to_the_thickness(sheet: EndlessSheet) -> None:
    reconstruction = sheet.scene.reconstruction
    steps = mapping.steps_on_screen(sheet.scene, sheet.geometry)
    footprint = reference.footprint_of(steps, sheet.grid.zoom, 1, reconstruction)
    pixels = torch.cartesian_prod(torch.arange(2, 4), torch.arange(2, 4)).double()
    dx, dy = (pixels[:, None, :] - sheet.positions()[None]).unbind(2)
    off = footprint.weights(dx, dy).sum(dim=1) / sheet.thickness - 1
    assert off.abs().max() <= DOCUMENTED_RIPPLE[reconstruction.kernel]


# So thin that all the weights over a pixel just add up.
THINNEST_CODE, THINNEST = 1, 1 / OPACITY_UNIT


@settings(max_examples=examples(25))
@given(endless_sheets())
def test_splatted_weights_sum_to_the_thickness(sheet: EndlessSheet) -> None:
    lattice = sheet.lattice()
    # Sums do not depend on the order, so one run may hold the whole sheet.
    corner = lattice.min(dim=0).values
    offset = lattice - corner
    packets = offset[:, 0] | offset[:, 1] << POSITION_BITS | THINNEST_CODE << OPACITY_SHIFT
    run = ROW_RUN.pack(0, 0, 0, len(packets), *corner.tolist())
    size, order = (sheet.scene.image.width, sheet.scene.image.height), Order.BACK_TO_FRONT
    with owners() as made:
        drawing = Drawing.begun(made, size, footprint_table(sheet.shape), order, counts=(1, 1, len(packets)))
        batch = BatchMemory(run + packets.numpy().tobytes(), [(1, len(packets))], drawing.budget)
        drawing.frame.push(0, batch, 0, 0, True)
        drawing.wait_until_complete()
        alpha = drawing.pixels()[..., 3].flatten().double()
    off = alpha / THINNEST / sheet.thickness - 1
    assert off.abs().max() <= DOCUMENTED_RIPPLE[sheet.scene.reconstruction.kernel] + UNITY_ROUNDED_POSITIONS


def test_the_default_kernel_is_even_within_1_percent() -> None:
    assert DOCUMENTED_RIPPLE[Reconstruction().kernel] <= 0.01
    assert DOCUMENTED_RIPPLE.keys() == DEFAULT_RADIUS.keys() == set(Kernel)
