"""The owners of regions: the same bits for any regions and threads, nothing left over, images of one's own."""

from __future__ import annotations

import random
import sys
import weakref
from itertools import pairwise

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from support.patience import PATIENCE
from support.programs.little_memory import little_memory
from support.scenes.owned import UNBOUNDED, Drawing, batch_of, even_regions, owners, splatted
from support.scenes.row_runs import Dot, Run, mirrored
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Kernel, Order
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.packet_layout import OPACITY_CODES
from volsplat.protocol.text.errors import NoThread
from volsplat.splat_server._kernels import BatchMemory, Bell, EdgeLayer, Ellipse, FootprintTable, Owners, ReadBudget
from volsplat.splat_server.footprint_table import kernel_projection

SMALL = (7, 5)
DOT = Dot(3 * 64, 2 * 64, OPACITY_CODES - 1, (255, 0, 51))
SIZE = (90, 70)
LARGE = (520, 260)
RADIUS = 4.0  # pixels
TABLE = FootprintTable(
    kernel_projection(Kernel.GAUSSIAN, 2.0), Ellipse(0.5, (2 / RADIUS) ** 2, 0.0, (2 / RADIUS) ** 2, RADIUS, RADIUS), 3
)


def sheet_of_dots(chance: random.Random, sheet: int, size: tuple[int, int], every: int = 3) -> list[Run]:
    """Over a part of the image, and beyond its rim."""
    width, height = size
    left, right = sorted(chance.randrange(-6, width + 6) for _ in range(2))
    top, bottom = sorted(chance.randrange(-6, height + 6) for _ in range(2))
    return [
        Run(
            sheet,
            row,
            0,
            tuple(
                Dot(
                    x * 64 + chance.randrange(64),
                    y * 64 + chance.randrange(64),
                    chance.choice((OPACITY_CODES - 1, chance.randrange(1, OPACITY_CODES))),
                    (chance.randrange(256), chance.randrange(256), chance.randrange(256)),
                )
                for x in range(left, right + 1, every)
            ),
        )
        for row, y in enumerate(range(top, bottom + 1, every))
    ]


def sheets_of_dots(seed: int, count: int, size: tuple[int, int] = SIZE) -> list[list[Run]]:
    chance = random.Random(seed)
    return [sheet_of_dots(chance, sheet, size) for sheet in range(count)]


def joined(sheets: list[list[Run]]) -> list[Run]:
    return [run for runs in sheets for run in runs]


def drawn(drawing: Drawing, sheets: list[list[Run]]) -> Tensor:
    for runs in sheets:
        drawing.push(runs)
    drawing.push([], last=True)
    drawing.wait_until_complete()
    return drawing.pixels()


def small_image() -> Tensor:
    return splatted([Run(0, 0, 0, (DOT,))], None, Order.BACK_TO_FRONT, SMALL)


@st.composite
def regions_of(draw: st.DrawFn, lines: int) -> list[tuple[int, int]]:
    """Any, some of them empty or one tile high."""
    tiles = st.integers(0, -(-lines // TILE_SIDE))
    inner = sorted(min(tile * TILE_SIDE, lines) for tile in draw(st.lists(tiles, max_size=7)))
    return list(pairwise([0, *inner, lines]))


@given(
    st.data(),
    st.integers(0, 1 << 30),
    st.sampled_from(TRAVERSAL_ORDERS),
    st.integers(1, 5),
    st.booleans(),
    st.sampled_from((1, 50, 1 << 17)),
)
def test_any_regions_threads_and_portions_give_the_same_bits_frame_after_frame(
    data: st.DataObject, seed: int, order: Order, threads: int, turned: bool, portion: int
) -> None:
    width, height = SIZE
    size = (height, width) if turned else SIZE
    with owners(threads) as made:
        for frame in range(2):
            sheets = sheets_of_dots(seed + frame, 4)
            regions = data.draw(regions_of(height))
            drawing = Drawing.begun(made, size, TABLE, order, turned, regions, portion=portion)
            image = drawn(drawing, sheets)
            expected = splatted(joined(sheets), TABLE, order, SIZE)
            assert torch.equal(
                (image.transpose(0, 1) if turned else image).view(torch.int32), expected.view(torch.int32)
            )


@pytest.mark.parametrize("turned", [False, True])
def test_a_part_of_the_regions_is_that_rectangle_of_the_image(turned: bool) -> None:
    sheets = sheets_of_dots(5, 3)
    whole = splatted(joined(sheets), TABLE, Order.FRONT_TO_BACK, SIZE)
    with owners(2) as made:
        drawing = Drawing.begun(
            made, SIZE[::-1] if turned else SIZE, TABLE, Order.FRONT_TO_BACK, turned, [(12, 40), (40, 64)]
        )
        part = drawn(drawing, sheets)
        assert drawing.frame.rectangle == ((12, 0, 52, 90) if turned else (0, 12, 90, 52))
        assert torch.equal(part, whole.transpose(0, 1)[:, 12:64] if turned else whole[12:64])


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("size", [LARGE, LARGE[::-1]])
def test_a_frame_without_samples_is_empty_whatever_was_drawn_before(size: tuple[int, int], turned: bool) -> None:
    with owners(2) as made:
        for frame in range(3):
            drawn(Drawing.begun(made, size, TABLE, turned=turned), sheets_of_dots(frame, 2, size))
            used = made.published(Drawing.begun(made, size, TABLE, turned=not turned).frame)
            used[:] = b"\xff" * len(used)  # in case its memory is used again
            del used
            assert not drawn(Drawing.begun(made, size, TABLE, turned=not turned), []).any()


def test_what_is_unfinished_at_a_new_frame_leaves_nothing_behind() -> None:
    sheets = sheets_of_dots(3, 4, LARGE)
    expected = splatted(joined(sheets), TABLE, Order.FRONT_TO_BACK, LARGE)
    with owners(2) as made:
        for turned in (False, True, False, False, True):
            unfinished = Drawing.begun(made, LARGE, TABLE, turned=turned, portion=100)
            for runs in sheets_of_dots(4, 9, LARGE):
                unfinished.push(runs)
            regions = even_regions(LARGE[1], 2)
            drawing = Drawing.begun(made, LARGE, TABLE, Order.FRONT_TO_BACK, regions=regions)
            unfinished.push([], last=True)  # too late
            assert torch.equal(drawn(drawing, sheets), expected)


def test_an_image_shown_while_it_is_drawn_has_regions_as_they_stand() -> None:
    sheets = sheets_of_dots(8, 5)
    with owners(2) as made:
        drawing = Drawing.begun(made, SIZE, TABLE, regions=even_regions(SIZE[1], 3))
        for n, runs in enumerate(sheets):
            drawing.push(runs)
            drawing.wait_until_all_wait()
            so_far = splatted(joined(sheets[: n + 1]), TABLE, Order.BACK_TO_FRONT, SIZE)
            assert torch.equal(drawing.pixels(), so_far)
        drawing.frame.finish(0)
        drawing.wait_until_complete()
        assert torch.equal(drawing.pixels(), so_far)


class Payload(bytearray):
    """That may be referred to weakly."""


@pytest.mark.parametrize("end", ["complete", "cancelled", "cleared", "closed"])
def test_a_batch_is_kept_until_it_is_splatted_or_dropped(end: str) -> None:
    news = Bell()
    budget = ReadBudget(UNBOUNDED, news)
    made = Owners(2)
    drawing = Drawing.begun(made, LARGE, TABLE, sources=2)
    memory = batch_of(sheets_of_dots(3, 1, LARGE)[0], budget)
    drawing.frame.push(0, memory, 1, 0, True)  # that waits for the other source
    del memory
    held = budget.held
    assert held > 0
    match end:
        case "complete":
            drawing.push([], source=1, last=True)
            drawing.wait_until_complete()
        case "cancelled":
            made.cancel()
        case "cleared":
            made.clear(*LARGE, False)
            del drawing
        case "closed":
            made.close()
            del made, drawing
    assert budget.held == 0


def test_memory_that_no_one_needs_is_let_go_of_with_the_next_batch() -> None:
    payload = Payload(b"")
    kept = weakref.ref(payload)
    budget = ReadBudget(UNBOUNDED, Bell())
    BatchMemory(payload, [], budget)
    del payload
    BatchMemory(b"", [], budget)
    assert kept() is None


def test_a_cancelled_frame_is_not_drawn_on() -> None:
    with owners(2) as made:
        drawing = Drawing.begun(made, LARGE, TABLE, portion=1)
        for runs in sheets_of_dots(1, 3, LARGE):
            drawing.push(runs)
        made.cancel()
        packets, at_first = drawing.frame.packets, drawing.pixels()
        drawing.push([], last=True)
        assert torch.equal(drawing.pixels(), at_first) and drawing.frame.packets == packets


def test_work_is_counted_where_runs_lie() -> None:
    runs = [Run(0, n, 0, (Dot(640, y * 64, 99, (1, 2, 3)),) * 2) for n, y in enumerate((-50, 0, 3, 4, 9, 9, 500))]
    with owners() as made:
        drawing = Drawing.begun(made, (40, 16), None, regions=[(0, 8), (8, 16)])
        drawn(drawing, [runs])
        # Each run is pushed to both regions, and what lies beyond one counts in its next row of tiles
        assert drawing.frame.work == [2 * 3, 2 * 4, 2 * 6, 2 * 1]


def test_a_published_image_is_rgba_by_rows() -> None:
    pixels = small_image()
    assert torch.equal(pixels[2, 3], torch.tensor((1.0, 0.0, 51 / 255, 1.0)))
    assert pixels.count_nonzero() == 3


def test_an_image_that_is_held_stays_as_it_is_and_outlives_its_owners() -> None:
    made = Owners(1)
    drawing = Drawing.begun(made, SMALL, None)
    drawn(drawing, [[Run(0, 0, 0, (DOT,))]])
    held = made.published(drawing.frame)
    before = bytes(held)
    for _ in range(9):
        drawn(Drawing.begun(made, SMALL, None), [])
    assert held == before
    made.close()
    del made, drawing
    held[:] = bytes(range(140)) * 4
    assert bytes(held) == bytes(range(140)) * 4


@pytest.mark.parametrize("complete", [True, False])
def test_edges_are_published_over_and_under_the_image(complete: bool) -> None:
    nothing, line = EdgeLayer(*SMALL), EdgeLayer(*SMALL)
    line.draw(0.0, 2.0, 6.0, 2.0, 1.0)

    def image(front: EdgeLayer, behind: EdgeLayer) -> Tensor:
        with owners() as made:
            drawing = Drawing.begun(made, SMALL, None, edges=(front, behind), regions=[(0, 4), (4, 5)])
            drawing.push([Run(0, 0, 0, (DOT,))], last=complete)
            if complete:
                drawing.wait_until_complete()
            else:
                drawing.wait_until_all_wait()
            return drawing.pixels()

    assert torch.equal(image(nothing, nothing), small_image())
    behind = image(nothing, line)
    assert torch.equal(behind[2, 3], torch.tensor((1.0, 0.0, 51 / 255, 1.0)))
    assert (behind[2, 2] == 1).all()
    before = image(line, nothing)
    assert (before[2] == 1).all() and not before[1].any()


def test_edges_of_another_size_and_regions_that_do_not_follow_each_other_are_refused() -> None:
    with owners() as made:
        with pytest.raises(ValueError, match="differ in size"):
            Drawing.begun(made, SMALL, None, edges=(EdgeLayer(8, 8), EdgeLayer(8, 8)))
        for regions in ([(0, 4), (0, 5)], [(0, 3), (3, 5)], [(0, 8)], [(4, 0)], [(-4, 4)]):
            with pytest.raises(ValueError, match="do not follow"):
                Drawing.begun(made, SMALL, None, regions=regions)


def test_closing_twice_does_no_harm() -> None:
    made = Owners(3)
    Drawing.begun(made, SMALL, None, regions=[(0, 4), (4, 5)])
    made.close()
    made.close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to the limit")
def test_threads_that_cannot_be_started_are_told_of() -> None:
    with owners(100000) as made:
        made.clear(*SMALL, False)
        with little_memory(64 << 20), pytest.raises(NoThread, match="ulimit -u"):
            Drawing.begun(made, SMALL, None, regions=[(0, 0)] * 99999 + [(0, 5)])


def test_a_bell_that_rang_before_is_heard_at_once() -> None:
    bell = Bell()
    heard = bell.rung
    bell.ring()
    assert bell.wait(heard, PATIENCE) == heard + 1
    assert bell.wait(heard + 1, 0.0) == heard + 1


@given(st.integers(0, 1 << 30), st.sampled_from(TRAVERSAL_ORDERS))
def test_a_turned_image_is_that_of_the_samples_with_x_and_y_exchanged(seed: int, order: Order) -> None:
    runs = joined(sheets_of_dots(seed, 2))
    turned = splatted(mirrored(runs), TABLE, order, SIZE, True, even_regions(SIZE[0], 3), 2)
    assert torch.equal(turned, splatted(mirrored(runs), TABLE, order, SIZE[::-1]).transpose(0, 1))


@pytest.mark.parametrize("turned", [False, True])
def test_an_image_is_published_in_memory_that_is_given_and_shown_in_other_memory(turned: bool) -> None:
    regions, sheets = [(12, 40), (40, 64)], sheets_of_dots(5, 3)
    block, shown = (memoryview(bytearray(52 * 90 * 16)) for _ in range(2))
    with owners(2) as made:
        drawing = Drawing.begun(
            made, SIZE[::-1] if turned else SIZE, TABLE, turned=turned, regions=regions, block=block
        )
        image = drawn(drawing, sheets)
        drawing.frame.show(shown)
        assert bytes(block) == bytes(shown) == image.numpy().tobytes() and any(block)
        with pytest.raises(ValueError, match="another size"):
            drawing.frame.show(shown[16:])
        with pytest.raises(ValueError, match="another size"):
            Drawing.begun(made, SIZE, TABLE, block=block)


def test_memory_to_publish_in_is_let_go_of_with_the_next_frame() -> None:
    block = bytearray(SIZE[0] * SIZE[1] * 16)
    before = sys.getrefcount(block)
    with owners() as made:
        drawn(Drawing.begun(made, SIZE, TABLE, block=memoryview(block)), sheets_of_dots(1, 2))
        assert sys.getrefcount(block) > before
        drawn(Drawing.begun(made, SIZE, TABLE), [])
        assert sys.getrefcount(block) == before
