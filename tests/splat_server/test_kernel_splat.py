"""The splat kernel against plain loops over samples and pixels in float64, on every CPU path of this machine."""

import random
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, lru_cache

import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from torch import Tensor

from reference import mapping
from reference.combining import FROZEN_ALPHA
from reference.render import cells_on_the_way
from support.scenes import owned
from support.scenes.arbitrary import plain_scene, situations
from support.scenes.owned import even_regions
from support.scenes.row_runs import FARTHEST, Dot, Run, mirrored, runs_of_samples
from support.thoroughness import examples
from tolerances import BETWEEN_CPU_PATHS, ONE_LEVEL, SPLAT_FLOAT32
from volsplat.bench.floors.cpu_paths import kernels_on
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Kernel, Order, Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.rules.frame_plan import FramePlan, Reach, plan_frame
from volsplat.protocol.rules.packet_layout import OPACITY_CODES, SUBPIXEL_BITS, opacity_of_code
from volsplat.protocol.rules.rounding import Thresholds, thresholds_of
from volsplat.splat_server import _kernels
from volsplat.splat_server._kernels import Ellipse, FootprintTable
from volsplat.splat_server.footprint_table import kernel_projection
from volsplat.splat_server.pixel_reach import PixelReach, cell_map

PATHS = _kernels.cpu_paths()
OPAQUE = OPACITY_CODES - 1
WHITE = (255, 255, 255)

FLAT_CELLS = ((1.0, 200.0, 0.0), (0.0, 1e-9, 0.0), (0.0, 0.0, 1e9))  # next to no area in a sheet

Affected = list[tuple[int, int, float]]  # x, y, weight


@pytest.fixture(params=PATHS)
def path(request: pytest.FixtureRequest) -> Iterator[str]:
    with kernels_on(_kernels, request.param):
        yield request.param


@cache
def table_of(half_width: float, half_height: float, amplitude: float, offset_bits: int) -> FootprintTable:
    """A leaning ellipse of these half extents."""
    radius = 2.0
    vxx, vyy = (half_width / radius) ** 2, (half_height / radius) ** 2
    vxy = 0.3 * (vxx * vyy) ** 0.5
    area = vxx * vyy - vxy * vxy
    ellipse = Ellipse(amplitude, vyy / area, -vxy / area, vxx / area, half_width, half_height)
    return FootprintTable(kernel_projection(Kernel.GAUSSIAN, radius), ellipse, offset_bits)


THRESHOLDS = thresholds_of(first_index=7, index_step=-1)


def footprint_pixels(table: FootprintTable, dot: Dot, sheet: int, width: int, height: int) -> Affected:
    """Those within an image."""
    shift = SUBPIXEL_BITS - table.offset_bits
    added = THRESHOLDS.of(sheet) << shift >> 32
    x, y = (dot.x + added) >> shift, (dot.y + added) >> shift
    n = 1 << table.offset_bits
    left, top, weights = table.weights_at(x % n, y % n)
    left, top = x // n + left, y // n + top
    return [
        (left + column, top + row, weights[row * table.width + column])
        for row in range(max(0, -top), min(table.height, height - top))
        for column in range(max(0, -left), min(table.width, width - left))
    ]


def nearest_pixel(dot: Dot) -> Affected:
    return [((dot.x + 32) // 64, (dot.y + 32) // 64, 1.0)]


def plainly_splatted(
    runs: list[Run],
    table: FootprintTable | None,
    order: Order,
    width: int,
    height: int,
    frozen_alpha: float = FROZEN_ALPHA,
) -> Tensor:
    """The paper's formulas, pixel by pixel."""
    image = [[0.0, 0.0, 0.0, 0.0] for _ in range(width * height)]
    for sheet, dot in ((run.sheet, dot) for run in runs for dot in run.dots):
        colour = [*(channel / 255 for channel in dot.colour), 1.0]
        for x, y, weight in footprint_pixels(table, dot, sheet, width, height) if table else nearest_pixel(dot):
            if not (weight > 0 and 0 <= x < width and 0 <= y < height):
                continue
            pixel = image[y * width + x]
            opacity = min(1.0, weight * opacity_of_code(dot.opacity))
            if order == Order.BACK_TO_FRONT:
                pixel[:] = [(1 - opacity) * c + opacity * i for c, i in zip(pixel, colour, strict=True)]
            elif pixel[3] < frozen_alpha:
                through = 1 - pixel[3]
                pixel[:] = [c + through * (opacity * i) for c, i in zip(pixel, colour, strict=True)]
    return torch.tensor(image, dtype=torch.float64).reshape(height, width, 4)


def splatted(
    runs: list[Run],
    reach: PixelReach,
    order: Order,
    width: int,
    height: int,
    threads: int = 1,
    turned: bool = False,
    thresholds: Thresholds = THRESHOLDS,
    frozen_alpha: float = FROZEN_ALPHA,
) -> Tensor:
    """By the kernel, a region for each thread."""
    regions = even_regions(width if turned else height, threads)
    return owned.splatted(runs, reach, order, (width, height), turned, regions, threads, thresholds, frozen_alpha)


@lru_cache(8)  # the same for all CPU paths, tables and orders; made in Python loops
def random_runs(seed: int, width: int, height: int, count: int = 60, margin: int = 12) -> list[Run]:
    """Samples in and around an image; those of a run go up, down or along the image, as on a line."""
    chance = random.Random(seed)
    runs = []
    for row in range(count // 4):
        x0, y0 = chance.randrange(-margin, width + margin) * 64, chance.randrange(-margin, height + margin) * 64
        across = sorted((chance.randrange(900) for _ in range(4)), reverse=chance.random() < 0.5)
        down = sorted((chance.randrange(900) for _ in range(4)), reverse=chance.random() < 0.5)
        dots = tuple(
            Dot(
                x0 + x,
                y0 + y,
                chance.choice((OPAQUE, chance.randrange(1, OPACITY_CODES))),
                (chance.randrange(256), chance.randrange(256), chance.randrange(256)),
            )
            for x, y in zip(across, down, strict=True)
        )
        runs.append(Run(row, 0, 0, dots))
    return runs


TABLES = {
    "small": (1.4, 1.4, 0.7, 6),
    "of 8 x 8 pixels": (4.0, 4.0, 1.0, 5),
    "above 1, so that opacities are cut": (3.3, 4.7, 9.0, 4),
    "of 11 pixels a row, some cut": (5.4, 3.1, 2.5, 3),
    "of 12 pixels a row": (5.9, 6.0, 0.8, 4),
    "flat": (9.2, 2.1, 1.0, 3),
    "of two vectors a row": (7.6, 3.2, 0.9, 3),
    "wide": (8.9, 4.2, 1.1, 2),
    "wider": (12.0, 5.3, 1.1, 2),
    "widest box": (15.2, 5.3, 1.1, 2),
    "larger than the image": (33.0, 21.0, 2.0, 0),
}


@cache
def expected_of_240(table_name: str, order: Order, width: int, height: int, frozen_alpha: float) -> Tensor:
    """Once for all CPU paths: loops in Python take most of the time."""
    runs = random_runs(width, width, height, count=240)
    return plainly_splatted(runs, table_of(*TABLES[table_name]), order, width, height, frozen_alpha)


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("table_name", TABLES)
@pytest.mark.parametrize(("width", "height"), [(37, 23), (1, 9), (16, 2)])
@pytest.mark.parametrize("frozen_alpha", [FROZEN_ALPHA, 0.75])
def test_footprints_combine_as_the_paper_says(
    path: str, table_name: str, order: Order, width: int, height: int, frozen_alpha: float
) -> None:
    runs = random_runs(width, width, height, count=240)
    image = splatted(runs, table_of(*TABLES[table_name]), order, width, height, frozen_alpha=frozen_alpha)
    expected = expected_of_240(table_name, order, width, height, frozen_alpha)
    assert (image - expected).abs().max() <= SPLAT_FLOAT32
    assert image.any()


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("table_name", [*TABLES, "nearest pixels"])
@pytest.mark.parametrize(("width", "height"), [(37, 23), (70, 133), (1, 9), (16, 2)])
@pytest.mark.parametrize("threads", [1, 3])
def test_a_turned_image_is_that_of_the_same_samples_with_x_and_y_exchanged(
    path: str, table_name: str, order: Order, width: int, height: int, threads: int
) -> None:
    table = table_of(*TABLES[table_name]) if table_name in TABLES else None
    runs = mirrored(random_runs(width, width, height, count=240))
    turned = splatted(runs, table, order, width, height, threads, turned=True)
    by_rows = splatted(runs, table, order, height, width)
    assert torch.equal(turned, by_rows.transpose(0, 1))
    assert turned.any()


def one_by_one(runs: list[Run]) -> list[Run]:
    """A run for each sample."""
    return [Run(run.sheet, run.row, run.first + n, (dot,)) for run in runs for n, dot in enumerate(run.dots)]


@st.composite
def level_runs(draw: st.DrawFn, width: int, height: int) -> list[Run]:
    """Runs whose samples mostly lie side by side in the same rows of pixels, some with gaps, steps back or aside."""
    runs = []
    for row in range(draw(st.integers(1, 6))):
        x, y = draw(st.integers(-8 * 64, width * 64)), draw(st.integers(-8 * 64, height * 64))
        step = draw(st.integers(-250, 250))
        dots = []
        for _ in range(draw(st.integers(1, 40))):
            x += step + draw(st.sampled_from((0, 0, 0, 0, 0, 0, 500, -500)))
            aside = draw(st.sampled_from((0, 0, 0, 0, 0, 0, 70)))
            opacity = draw(st.sampled_from((OPAQUE, OPAQUE // 2, 3000, 1)))
            dots.append(Dot(x, y + aside, opacity, (draw(st.integers(0, 255)), 200, 100)))
        least = min(dot.x for dot in dots)
        runs.append(Run(0, row, 0, tuple(dot for dot in dots if dot.x - least <= FARTHEST)))
    return runs


@given(st.data(), st.sampled_from(PATHS), st.sampled_from(TRAVERSAL_ORDERS), st.sampled_from(sorted(TABLES)))
def test_samples_of_one_run_give_the_bits_of_runs_of_one_sample(
    data: st.DataObject, path: str, order: Order, table_name: str
) -> None:
    width, height = 61, 23
    runs = data.draw(level_runs(width, height))
    alone = one_by_one(runs)
    table = table_of(*TABLES[table_name])
    with kernels_on(_kernels, path):
        together = splatted(runs, table, order, width, height)
        assert torch.equal(together, splatted(alone, table, order, width, height))
        assert torch.equal(together, splatted(runs, table, order, width, height, threads=3))


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_nearest_pixels_combine_as_the_paper_says(path: str, order: Order) -> None:
    runs = random_runs(3, 19, 11, count=400, margin=3)
    image = splatted(runs, None, order, 19, 11)
    assert (image - plainly_splatted(runs, None, order, 19, 11)).abs().max() <= SPLAT_FLOAT32
    assert image.any()


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("table_name", TABLES)
def test_the_paths_agree(table_name: str, order: Order) -> None:
    runs = random_runs(11, 45, 33, count=200)
    images = []
    for path in PATHS:
        with kernels_on(_kernels, path):
            images.append(splatted(runs, table_of(*TABLES[table_name]), order, 45, 33))
    assert all((image - images[0]).abs().max() <= BETWEEN_CPU_PATHS for image in images)


@pytest.mark.parametrize("table", [*TABLES.values(), (33.3, 40.7, 1.0, 1)])
def test_footprint_tables_have_the_same_bits_on_all_paths(table: tuple[float, float, float, int]) -> None:
    tables = []
    for path in PATHS:
        with kernels_on(_kernels, path):
            made = table_of(*table)
            offsets = range(1 << made.offset_bits)
            tables.append([made.weights_at(fx, fy) for fx in offsets for fy in offsets])
    assert all(table == tables[0] for table in tables)


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize(("width", "height"), [(40, 33), (61, 7), (23, 64)])
def test_threads_give_the_same_bits(path: str, order: Order, threads: int, width: int, height: int) -> None:
    runs = random_runs(5, width, height, count=400)
    for reach in (*(table_of(*TABLES[table_name]) for table_name in TABLES), None):
        assert torch.equal(
            splatted(runs, reach, order, width, height, threads), splatted(runs, reach, order, width, height)
        )


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_a_sample_anywhere_beyond_the_image_leaves_it_alone(path: str, order: Order) -> None:
    ends = (-(2**31), -(2**31) + 5, -64 * 64, 64 * 64, 2**31 - 1 - FARTHEST, 2**31 - 1)
    runs = [Run(0, n, 0, (Dot(x, y, OPAQUE, WHITE),)) for n, (x, y) in enumerate((x, y) for x in ends for y in ends)]
    for reach in (table_of(*TABLES["larger than the image"]), None):
        assert not splatted(runs, reach, order, 33, 21).any()


def test_positions_and_keys_that_no_plan_has_do_no_harm_to_cells(path: str) -> None:
    plan = plan_frame(plain_scene(view=View(zoom=200)), Geometry((50, 60, 70)), Step.A)
    ends = (-(2**31), 0, 2**31 - 1)
    keys = (0, 5, 2**20 - 1)
    runs = [Run(s, r, 0, (Dot(x, y, OPAQUE, WHITE),)) for s in keys for r in keys for x in ends for y in ends][::9]
    image = splatted(runs, cell_map(plan), Order.BACK_TO_FRONT, 20, 20)
    assert image.min() >= 0 and image.max() <= 1


@pytest.mark.parametrize("frozen_alpha", [FROZEN_ALPHA, 0.75])
def test_a_frozen_pixel_changes_no_more(path: str, frozen_alpha: float) -> None:
    table = table_of(*TABLES["of 8 x 8 pixels"])
    opaque = [Run(0, n, 0, (Dot(640, 640, OPAQUE, (9, 99, 199)),)) for n in range(200)]
    more = [Run(1, n, 0, (Dot(640, 640, OPAQUE, WHITE),)) for n in range(50)]
    before, after = (
        splatted(runs, table, Order.FRONT_TO_BACK, 20, 20, frozen_alpha=frozen_alpha)
        for runs in (opaque, opaque + more)
    )
    frozen = before[..., 3] >= frozen_alpha
    assert frozen.any() and not frozen.all()
    assert torch.equal(after[frozen], before[frozen])
    nearly = (before[..., 3] > 0) & ~frozen
    assert (after[nearly] > before[nearly]).any()


@given(
    st.lists(st.tuples(st.integers(0, FARTHEST), st.integers(0, FARTHEST)), min_size=1, max_size=40), st.integers(1, 4)
)
def test_a_run_that_is_no_line_does_no_harm(offsets: list[tuple[int, int]], threads: int) -> None:
    """Only a broken server sends one."""
    dots = tuple(
        Dot(x - 3000, y - 3000, OPACITY_CODES // 2, WHITE) for x, y in [(0, 0), *offsets, (FARTHEST, FARTHEST)]
    )
    runs = [Run(0, row, 0, dots) for row in range(200)]
    image = splatted(runs, table_of(*TABLES["of 8 x 8 pixels"]), Order.FRONT_TO_BACK, 160, 160, threads)
    assert image.isfinite().all() and image.min() >= 0 and image.max() <= 1


@given(st.integers(0, 1 << 30), st.integers(1, 200), st.sampled_from(sorted(TABLES)))
def test_both_orders_give_one_image(seed: int, count: int, table_name: str) -> None:
    table = table_of(*TABLES[table_name])
    forward = random_runs(seed, 24, 18, count + 4)
    last = forward[-1].sheet
    dots = [(last - run.sheet, dot) for run in forward for dot in run.dots]
    backward = [Run(sheet, n, 0, (dot,)) for n, (sheet, dot) in enumerate(reversed(dots))]
    back_to_front = splatted(forward, table, Order.BACK_TO_FRONT, 24, 18, thresholds=thresholds_of(0, 1))
    front_to_back = splatted(backward, table, Order.FRONT_TO_BACK, 24, 18, thresholds=thresholds_of(last, -1))
    assert (back_to_front - front_to_back).abs().max() <= ONE_LEVEL


def sheet_of(scene: Scene, geometry: Geometry, plan: FramePlan, opacity: int, chosen: int) -> tuple[int, list[Run]]:
    """The runs of all samples of one sheet, and the sheet."""
    samples = mapping.samples_of(scene, geometry, plan)
    sheets = torch.unique(samples.ordinals[:, 0])
    sheet = int(sheets[chosen % len(sheets)])
    here = samples.ordinals[:, 0] == sheet
    return sheet, runs_of_samples(samples.ordinals[here], samples.lattice[here], opacity, WHITE)


def coloured(runs: list[Run]) -> list[Run]:
    """Every sample with a colour of its own."""
    chance = random.Random(len(runs))
    return [
        replace(
            run,
            dots=tuple(replace(dot, colour=(chance.randrange(256), n % 256, 100)) for n, dot in enumerate(run.dots)),
        )
        for run in runs
    ]


@settings(max_examples=examples(80))
@given(
    situations(),
    st.sampled_from((Step.A, Step.B, Step.C)),
    st.integers(0, 12),
    st.sampled_from(PATHS),
    st.sampled_from((1, 3)),
)
def test_the_cells_of_a_sheet_have_no_hole_and_no_overlap(
    situation: tuple[Scene, Geometry], step: Step, chosen: int, path: str, threads: int
) -> None:
    scene, geometry = situation
    plan = plan_frame(scene, geometry, step)
    assume(plan.reach == Reach.CELL)
    half = OPACITY_CODES - 256  # so that each time that a cell covers a pixel shows
    sheet, runs = sheet_of(scene, geometry, plan, half, chosen)
    runs = coloured(runs)
    alone = one_by_one(runs)
    with kernels_on(_kernels, path):
        cells = cell_map(plan)
        image = splatted(runs, cells, plan.order, plan.width, plan.height, threads)
        assert torch.equal(image, splatted(alone, cells, plan.order, plan.width, plan.height))
    thirds = sum(((row >= 0) & (sample >= 0)).long() for row, sample in cells_on_the_way(plan, sheet))
    expected = 1 - (1 - opacity_of_code(half)) ** thirds
    assert (image[..., 3].flatten() - expected).abs().max() <= SPLAT_FLOAT32


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.1, 1.0)])
def test_a_long_row_of_cells_is_that_of_each_cell_alone(
    path: str, order: Order, rotation: tuple[float, float, float, float]
) -> None:
    scene = plain_scene(view=View(rotation=rotation, zoom=1.2), size=(300, 20), order=order)
    check_cells_alone(scene, Geometry((200, 5, 5)), shortest=150)


@pytest.mark.parametrize("matrix", [FLAT_CELLS, tuple(tuple(-c for c in row) for row in FLAT_CELLS)])
@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_cells_of_next_to_no_area_are_those_of_each_cell_alone(path: str, order: Order, matrix: Matrix) -> None:
    scene = plain_scene(view=View(zoom=1.0), size=(201, 201), order=order)
    check_cells_alone(scene, Geometry((12, 11, 3), matrix))


def check_cells_alone(scene: Scene, geometry: Geometry, shortest: int = 1) -> None:
    plan = plan_frame(scene, geometry, Step.C)
    _, runs = sheet_of(scene, geometry, plan, OPACITY_CODES - 256, 1)
    runs = coloured(runs)
    assert max(len(run.dots) for run in runs) >= shortest
    together, alone = (
        splatted(some, cell_map(plan), scene.order, plan.width, plan.height) for some in (runs, one_by_one(runs))
    )
    assert torch.equal(together, alone) and together.any()


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("rotation", [(0.1, 0.2, 0.3, 1.0), (0.0, 0.2, 0.0, 1.0), (0.2, 0.0, 0.0, 1.0)])
def test_an_opaque_sheet_is_exactly_1_inside(
    path: str, order: Order, rotation: tuple[float, float, float, float]
) -> None:
    scene = plain_scene(view=View(rotation=rotation, zoom=3.3), size=(40, 40), order=order)
    geometry = Geometry((40, 40, 40))
    plan = plan_frame(scene, geometry, Step.C)
    _, runs = sheet_of(scene, geometry, plan, OPAQUE, 20)
    assert (splatted(runs, cell_map(plan), order, 40, 40) == 1).all()


@given(st.floats(0.25, 0.7), st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(c * c for c in q) > 0.1))
def test_nearest_pixels_below_one_pixel_a_voxel_leave_no_hole(
    zoom: float, rotation: tuple[float, float, float, float]
) -> None:
    scene = plain_scene(view=View(rotation=rotation, zoom=zoom), size=(5, 5))
    geometry = Geometry((60, 60, 60))
    plan = plan_frame(scene, geometry, Step.C)
    assume(plan.reach == Reach.PIXEL)
    sheet = (geometry.dims[plan.traversal.axes[0]]) // 2
    samples = mapping.samples_of(scene, geometry, plan)
    lattice = samples.lattice[(samples.ordinals[:, 0] - sheet).abs() <= 0]
    near = (lattice.abs() < 64 * 20).all(dim=1)
    runs = [Run(0, n, 0, (Dot(x, y, OPAQUE, WHITE),)) for n, (x, y) in enumerate(lattice[near].tolist())]
    assert (splatted(runs, None, Order.BACK_TO_FRONT, 5, 5) == 1).all()
