"""Closed tiles: what is hidden is left out without changing a bit, and only what is frozen counts as closed."""

import math
import random
from collections.abc import Iterator

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference.combining import FROZEN_ALPHA
from support.scenes.owned import Drawing, even_regions, owners
from support.scenes.row_runs import Dot, Run
from volsplat.bench.floors.cpu_paths import kernels_on
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Kernel, Order
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, WORD_TILES, tile_map_shape
from volsplat.protocol.rules.packet_layout import OPACITY_CODES
from volsplat.splat_server import _kernels
from volsplat.splat_server._kernels import Ellipse, FootprintTable
from volsplat.splat_server.footprint_table import kernel_projection

OPAQUE = OPACITY_CODES - 1
LAYERS = 6

sizes = st.integers(1, 70)


@pytest.fixture(params=_kernels.cpu_paths(), autouse=True, scope="module")
def path(request: pytest.FixtureRequest) -> Iterator[str]:
    with kernels_on(_kernels, request.param):
        yield request.param


def footprint(half_width: float, half_height: float, amplitude: float) -> FootprintTable:
    qxx, qyy = (2 / half_width) ** 2, (2 / half_height) ** 2
    ellipse = Ellipse(amplitude, qxx, 0.0, qyy, half_width, half_height)
    return FootprintTable(kernel_projection(Kernel.GAUSSIAN, 2.0), ellipse, 3)


FOOTPRINTS = {
    (half_width, half_height): footprint(half_width, half_height, 4.0)
    for half_width, half_height in ((1.5, 1.5), (4.0, 4.0), (3.2, 7.1), (11.0, 6.0), (40.0, 9.0))
}


def layers(seed: int, width: int, height: int, opaque: float) -> list[list[Run]]:
    """Sheets of samples over and around a part of the image, nearly opaque ones among them."""
    chance = random.Random(seed)
    x_begin, x_end = sorted(chance.randrange(-10, width + 10) for _ in range(2))
    sheets = []
    for sheet in range(LAYERS):
        runs = []
        for row, y in enumerate(range(-6, height + 6, 3)):
            dots = tuple(
                Dot(
                    x * 64 + chance.randrange(64),
                    y * 64 + chance.randrange(64),
                    OPAQUE if chance.random() < opaque else chance.randrange(1, OPACITY_CODES),
                    (chance.randrange(256), chance.randrange(256), chance.randrange(256)),
                )
                for x in range(x_begin, x_end + 1, 3)
            )
            runs.append(Run(sheet, row, 0, dots))
        sheets.append(runs)
    return sheets


def splat(drawing: Drawing, runs: list[Run]) -> None:
    """Wait until they are in the image."""
    drawing.push(runs)
    drawing.wait_until_all_wait()


def words(drawing: Drawing) -> list[list[int]]:
    tiles = drawing.owners.closed_tiles
    rows, columns = tiles.shape or ()
    flat = tiles.cast("B").cast("Q").tolist()
    return [flat[row * columns : (row + 1) * columns] for row in range(rows)]


def forget(drawing: Drawing) -> None:
    """Empty the map, so that nothing counts as hidden."""
    tiles = drawing.owners.closed_tiles.cast("B")
    tiles[:] = bytes(len(tiles))


@given(st.integers(0, 1 << 30), sizes, sizes, st.sampled_from(sorted(FOOTPRINTS)), st.integers(1, 3), st.booleans())
def test_leaving_out_what_is_hidden_changes_no_bit(
    seed: int, width: int, height: int, size: tuple[float, float], threads: int, dense: bool
) -> None:
    table = FOOTPRINTS[size]
    sheets = layers(seed, width, height, 0.9 if dense else 0.3)
    with owners(threads) as first, owners() as second, owners(threads) as third:
        regions = even_regions(height, threads)
        by_rows = Drawing.begun(first, (width, height), table, Order.FRONT_TO_BACK, regions=regions)
        forgetful = Drawing.begun(second, (width, height), table, Order.FRONT_TO_BACK)
        turned = Drawing.begun(third, (height, width), table, Order.FRONT_TO_BACK, turned=True, regions=regions)
        for runs in sheets:
            splat(by_rows, runs)
            splat(turned, runs)
            for run in runs:
                forget(forgetful)
                splat(forgetful, [run])
        assert torch.equal(by_rows.pixels(), forgetful.pixels())
        assert torch.equal(turned.pixels(), forgetful.pixels().transpose(0, 1))
        assert words(turned) == words(by_rows)


@given(st.integers(0, 1 << 30), sizes, sizes, st.sampled_from(sorted(FOOTPRINTS)), st.integers(1, 3))
def test_the_map_only_rises_and_a_closed_tile_is_frozen(
    seed: int, width: int, height: int, size: tuple[float, float], threads: int
) -> None:
    with owners(threads) as made:
        regions = even_regions(height, threads)
        drawing = Drawing.begun(made, (width, height), FOOTPRINTS[size], Order.FRONT_TO_BACK, regions=regions)
        assert made.closed_tiles.shape == tile_map_shape(width, height)
        before = words(drawing)
        for runs in layers(seed, width, height, 0.9):
            splat(drawing, runs)
            after = words(drawing)
            alpha = drawing.pixels()[..., 3]
            for row, (old, new) in enumerate(zip(before, after, strict=True)):
                for number, (was, now) in enumerate(zip(old, new, strict=True)):
                    assert was & ~now == 0
                    for bit in (bit for bit in range(WORD_TILES) if now >> bit & 1):
                        left, top = (number * WORD_TILES + bit) * TILE_SIDE, row * TILE_SIDE
                        tile = alpha[top : top + TILE_SIDE, left : left + TILE_SIDE]
                        assert tile.numel() and (tile >= FROZEN_ALPHA).all()
            before = after


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("width", "height"), [(64, 48), (250, 20), (30, 29)])
def test_behind_an_opaque_wall_all_is_hidden_and_told(width: int, height: int, turned: bool) -> None:
    table = FOOTPRINTS[4.0, 4.0]
    wall = [
        Run(sheet, row, 0, tuple(Dot(x * 64, y * 64, OPAQUE, (9, 9, 9)) for x in range(-2, width + 2, 2)))
        for sheet in range(LAYERS)
        for row, y in enumerate(range(-2, height + 2, 2))
    ]
    behind = [Run(LAYERS, 0, 0, tuple(Dot(x * 64, 700, OPAQUE, (255, 0, 0)) for x in range(0, width, 5)))]
    size = (height, width) if turned else (width, height)
    with owners() as made:
        drawing = Drawing.begun(made, size, table, Order.FRONT_TO_BACK, turned)
        assert made.closed_tiles.shape == tile_map_shape(width, height)
        splat(drawing, wall)
        rows, columns = math.ceil(height / TILE_SIDE), math.ceil(width / TILE_SIDE)
        assert sum(word.bit_count() for row in words(drawing) for word in row) == rows * columns
        seen = drawing.frame.hidden_packets
        before = drawing.pixels()
        splat(drawing, behind)
        assert torch.equal(drawing.pixels(), before)
        assert drawing.frame.hidden_packets - seen == len(behind[0].dots)
        again = Drawing.begun(made, size, table, Order.FRONT_TO_BACK, turned)
        assert again.frame.hidden_packets == 0 and not any(map(any, words(again)))


def test_back_to_front_nothing_is_hidden() -> None:
    with owners() as made:
        drawing = Drawing.begun(made, (40, 40), FOOTPRINTS[4.0, 4.0], Order.BACK_TO_FRONT)
        for runs in layers(1, 40, 40, 1.0):
            splat(drawing, runs)
        assert drawing.frame.hidden_packets == 0 and not any(map(any, words(drawing)))


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_nearest_pixels_close_no_tile(order: Order) -> None:
    wall = [Run(0, y, 0, tuple(Dot(x * 64, y * 64, OPAQUE, (9, 9, 9)) for x in range(8))) for y in range(8)]
    with owners() as made:
        drawing = Drawing.begun(made, (8, 8), None, order)
        splat(drawing, wall)
        assert (drawing.pixels()[..., 3] == 1).all() and not any(map(any, words(drawing)))
