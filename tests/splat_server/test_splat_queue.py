"""Jobs that stripes pass through at their own pace: the same bits, nothing left over, nothing waited for in vain."""

from __future__ import annotations

import random
import threading
import weakref
from collections.abc import Callable

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from support.patience import PATIENCE
from support.scenes.row_runs import Dot, PinnedSpans, Run, spans_of
from support.scenes.threaded import everything_threaded
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Kernel, Order
from volsplat.protocol.rules.packet_layout import OPACITY_CODES
from volsplat.splat_server._kernels import Ellipse, FootprintTable
from volsplat.splat_server.footprint_table import kernel_projection
from volsplat.splat_server.image_buffer import ImageBuffer

WIDTH, HEIGHT = 90, 70
LARGE = (520, 260)  # pixels: threads share the handing out of such an image, even with nothing before it
RADIUS = 4.0  # pixels
TABLE = FootprintTable(
    kernel_projection(Kernel.GAUSSIAN, 2.0), Ellipse(0.5, (2 / RADIUS) ** 2, 0.0, (2 / RADIUS) ** 2, RADIUS, RADIUS), 3
)


def sheet_of_dots(chance: random.Random, width: int, height: int, every: int = 3) -> list[Run]:
    """Over a part of the image, and beyond its rim."""
    left, right = sorted(chance.randrange(-6, width + 6) for _ in range(2))
    top, bottom = sorted(chance.randrange(-6, height + 6) for _ in range(2))
    return [
        Run(
            0,
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


def sheets_of_dots(seed: int, count: int, width: int = WIDTH, height: int = HEIGHT) -> list[list[Run]]:
    chance = random.Random(seed)
    return [sheet_of_dots(chance, width, height) for _ in range(count)]


def long_job(width: int, height: int) -> PinnedSpans:
    """Takes some milliseconds."""
    chance = random.Random(1)
    return spans_of([run for sheet in range(4) for run in _numbered(sheet, sheet_of_all(chance, width, height))])


def sheet_of_all(chance: random.Random, width: int, height: int) -> list[Run]:
    return [
        Run(0, y, 0, tuple(Dot(x * 64 + chance.randrange(64), y * 64, 900, (200, 90, 30)) for x in range(0, width, 2)))
        for y in range(0, height, 2)
    ]


def _numbered(sheet: int, runs: list[Run]) -> list[Run]:
    return [Run(sheet, run.row, run.first, run.dots) for run in runs]


def pixels(memory: memoryview, width: int, height: int) -> Tensor:
    return torch.frombuffer(bytearray(memory), dtype=torch.int32).reshape(height, width, 4)  # so that -0 is not 0


def one_after_the_other(sheets: list[list[Run]], order: Order, width: int = WIDTH, height: int = HEIGHT) -> Tensor:
    image = ImageBuffer(width, height)
    for runs in sheets:
        splat(image, runs, order)
    return pixels(image.snapshot(), width, height)


def splat(image: ImageBuffer, runs: list[Run], order: Order = Order.BACK_TO_FRONT) -> None:
    pinned = spans_of(runs)
    image.splat(pinned.spans, TABLE, order, batches=pinned)


@given(
    st.integers(0, 1 << 30),
    st.sampled_from(TRAVERSAL_ORDERS),
    st.sampled_from((2, 3, 5)),
    st.booleans(),
    st.tuples(st.integers(-5, HEIGHT + 5), st.integers(-5, HEIGHT + 5)),
    st.lists(st.booleans(), min_size=12, max_size=12),
)
def test_queued_jobs_give_the_bits_of_one_after_the_other(
    seed: int, order: Order, threads: int, turned: bool, busy: tuple[int, int], threaded: list[bool]
) -> None:
    sheets = sheets_of_dots(seed, len(threaded))
    size = (HEIGHT, WIDTH) if turned else (WIDTH, HEIGHT)
    image = ImageBuffer(*size, threads)
    image.clear(turned, busy)
    for runs, queued in zip(sheets, threaded, strict=True):
        if queued:
            with everything_threaded():
                splat(image, runs, order)
        else:
            splat(image, runs, order)
    handed_out = pixels(image.hand_out(), *size)
    assert torch.equal(handed_out.transpose(0, 1) if turned else handed_out, one_after_the_other(sheets, order))
    assert not any(image.snapshot())
    image.close()


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("size", [LARGE, LARGE[::-1]])
def test_a_frame_without_samples_is_empty_whatever_was_drawn_before(size: tuple[int, int], turned: bool) -> None:
    image = ImageBuffer(*size, threads=2)
    for _ in range(3):
        image.clear(turned)
        with everything_threaded():
            splat(image, sheet_of_all(random.Random(2), *size))
        used = image.hand_out()
        used[:] = b"\xff" * len(used)  # in case its memory is used again
        del used
        image.clear(not turned)
        assert not any(image.hand_out())
    image.close()


def test_what_is_unfinished_at_a_new_frame_leaves_nothing_behind() -> None:
    image = ImageBuffer(*LARGE, threads=2)
    drawn = sheets_of_dots(3, 4, *LARGE)
    expected = one_after_the_other(drawn, Order.FRONT_TO_BACK, *LARGE)
    unfinished = long_job(*LARGE)
    for turned in (False, True, False, False, True):
        with everything_threaded():
            image.clear(turned)
            for _ in range(3):
                image.splat(unfinished.spans, TABLE, Order.FRONT_TO_BACK, batches=unfinished)
            image.clear(False)
            for runs in drawn:
                splat(image, runs, Order.FRONT_TO_BACK)
        assert torch.equal(pixels(image.hand_out(), *LARGE), expected)
    image.close()


ENDS: dict[str, Callable[[ImageBuffer], object]] = {
    "finish": ImageBuffer.finish,
    "hand_out": ImageBuffer.hand_out,
    "cancel": ImageBuffer.cancel,
    "clear": lambda image: image.clear(turned=False),
    "close": ImageBuffer.close,
}


class Memory:
    """Stands for a batch's."""


@pytest.mark.parametrize("end", ENDS)
def test_a_batch_is_kept_until_it_is_splatted_or_dropped(end: str) -> None:
    image = ImageBuffer(*LARGE, threads=2)
    pinned, memory = long_job(*LARGE), Memory()
    kept = weakref.ref(memory)
    with everything_threaded():
        image.splat(pinned.spans, TABLE, Order.BACK_TO_FRONT, batches=memory)
    del memory  # the job may be over already, if this thread was held up
    assert kept() is not None or not image.busy
    ENDS[end](image)
    assert kept() is None
    image.close()


def test_a_cancelled_job_is_not_drawn_on() -> None:
    image = ImageBuffer(*LARGE, threads=2)
    unfinished = long_job(*LARGE)
    with everything_threaded():
        for _ in range(3):
            image.splat(unfinished.spans, TABLE, Order.BACK_TO_FRONT, batches=unfinished)
    image.cancel()
    busy, at_first = image.busy_seconds, bytes(image.snapshot())
    image.finish()
    assert bytes(image.snapshot()) == at_first and image.busy_seconds == busy
    image.close()


def test_a_closed_buffer_splats_by_its_caller() -> None:
    image = ImageBuffer(*LARGE, threads=2)
    image.close()
    drawn = sheets_of_dots(4, 3, *LARGE)
    handed_out: list[Tensor] = []

    def draw() -> None:
        for runs in drawn:
            splat(image, runs)
        handed_out.append(pixels(image.hand_out(), *LARGE))

    with everything_threaded():
        thread = threading.Thread(target=draw, daemon=True)
        thread.start()
        thread.join(PATIENCE)
    assert torch.equal(handed_out[0], one_after_the_other(drawn, Order.BACK_TO_FRONT, *LARGE))


@pytest.mark.parametrize("threads", [1, 2])
def test_the_busy_clock_runs_while_there_is_something_to_do(threads: int) -> None:
    image = ImageBuffer(*LARGE, threads)
    job = long_job(*LARGE)
    image.splat(job.spans, TABLE, Order.BACK_TO_FRONT, batches=job)
    image.finish()
    splatted = image.busy_seconds
    assert splatted > 0 and image.busy_seconds == splatted
    image.hand_out()
    assert image.busy_seconds > splatted
    image.close()
