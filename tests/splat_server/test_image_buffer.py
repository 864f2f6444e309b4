"""The image buffer as it is handed out: memory of one's own, used again only when let go."""

import sys

import psutil
import pytest
import torch

from support.programs.little_memory import little_memory
from support.scenes.row_runs import Dot, Run, spans_of
from volsplat.protocol.description.scene import Order
from volsplat.protocol.rules.packet_layout import OPACITY_CODES
from volsplat.splat_server._kernels import EdgeLayer, ImageMemory, SplatQueue
from volsplat.splat_server.image_buffer import ImageBuffer

DOT = Dot(3 * 64, 2 * 64, OPACITY_CODES - 1, (255, 0, 51))


def image_with_a_dot() -> ImageBuffer:
    image = ImageBuffer(7, 5)
    pinned = spans_of([Run(0, 0, 0, (DOT,))])
    image.splat(pinned.spans, None, Order.BACK_TO_FRONT)
    return image


def test_a_snapshot_is_rgba_by_rows() -> None:
    pixels = torch.frombuffer(image_with_a_dot().snapshot(), dtype=torch.float32).reshape(5, 7, 4)
    assert torch.equal(pixels[2, 3], torch.tensor((1.0, 0.0, 51 / 255, 1.0)))
    assert pixels.count_nonzero() == 3


def test_a_snapshot_that_is_held_stays_as_it_is() -> None:
    image = image_with_a_dot()
    held = image.snapshot()
    before = bytes(held)
    image.clear(turned=False)
    others = [image.snapshot() for _ in range(9)]
    assert held == before
    assert all(not any(other) for other in others)


def test_a_snapshot_may_be_written_and_outlives_the_image() -> None:
    image = image_with_a_dot()
    mine = image.snapshot()
    mine[:] = bytes(range(140)) * 4
    assert image.snapshot() != mine
    del image
    assert bytes(mine) == bytes(range(140)) * 4


def test_what_was_written_into_a_snapshot_is_not_seen_again() -> None:
    image = image_with_a_dot()
    expected = bytes(image.snapshot())
    for _ in range(3):
        view = image.snapshot()
        view[:] = b"\xff" * len(view)
        del view
    assert image.snapshot() == expected


def test_edges_are_published_over_and_under_the_image() -> None:
    image = image_with_a_dot()
    nothing, line = EdgeLayer(7, 5), EdgeLayer(7, 5)
    line.draw(0.0, 2.0, 6.0, 2.0, 1.0)
    plain = torch.frombuffer(image.published(nothing, nothing), dtype=torch.float32)
    assert torch.equal(plain, torch.frombuffer(image.snapshot(), dtype=torch.float32))
    behind = torch.frombuffer(image.published(nothing, line), dtype=torch.float32).reshape(5, 7, 4)
    assert torch.equal(behind[2, 3], torch.tensor((1.0, 0.0, 51 / 255, 1.0)))
    assert (behind[2, 2] == 1).all()
    before = torch.frombuffer(image.published(line, nothing), dtype=torch.float32).reshape(5, 7, 4)
    assert (before[2] == 1).all() and not before[1].any()


def test_closing_twice_does_no_harm() -> None:
    image = ImageBuffer(8, 8, threads=3)
    image.close()
    image.close()


def test_there_are_no_more_threads_than_rows_of_tiles() -> None:
    before = psutil.Process().num_threads()
    image = ImageBuffer(8, 10, threads=100000)
    assert psutil.Process().num_threads() <= before + 2
    image.close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to the limit")
def test_threads_that_cannot_be_started_are_told_of() -> None:
    image = ImageMemory(8, 8)
    with little_memory(64 << 20), pytest.raises(RuntimeError):
        SplatQueue(image, 100000)
