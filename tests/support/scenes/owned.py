"""Has the owners of regions splat what a test made by hand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

from support.patience import PATIENCE
from support.scenes.row_runs import Run, batch_bytes
from volsplat.protocol.description.scene import Order
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.protocol.rules.rounding import TO_NEAREST, Thresholds
from volsplat.splat_server._kernels import BatchMemory, Bell, EdgeLayer, Owners, ReadBudget, SplatFrame
from volsplat.splat_server.pixel_reach import PixelReach

COUNTS = (1 << 20, 1 << 20, 1 << 20)
UNBOUNDED = 1 << 62


@contextmanager
def owners(threads: int = 1) -> Iterator[Owners]:
    made = Owners(threads)
    try:
        yield made
    finally:
        made.close()


@dataclass
class Drawing:
    """A frame that a test has drawn."""

    owners: Owners
    frame: SplatFrame
    news: Bell
    budget: ReadBudget
    size: tuple[int, int]
    regions: int

    @classmethod
    def begun(
        cls,
        owners: Owners,
        size: tuple[int, int],
        reach: PixelReach,
        order: Order = Order.BACK_TO_FRONT,
        turned: bool = False,
        regions: Sequence[tuple[int, int]] | None = None,
        sources: int = 1,
        counts: tuple[int, int, int] = COUNTS,
        thresholds: Thresholds = TO_NEAREST,
        portion: int = 1 << 17,
        edges: tuple[EdgeLayer, EdgeLayer] | None = None,
        budget: int = UNBOUNDED,
        block: memoryview | None = None,
        frozen_alpha: float = FROZEN_ALPHA,
    ) -> Drawing:
        """On a clear image of this size as it is published. Without regions it is one."""
        owners.clear(*size, turned)
        whole = [(0, size[0] if turned else size[1])]
        news = Bell()
        frame = owners.begin(
            regions=regions or whole,
            reach=reach,
            front_to_back=order == Order.FRONT_TO_BACK,
            frozen_alpha=frozen_alpha,
            thresholds=thresholds,
            counts=counts,
            sources=sources,
            portion=portion,
            edges=edges,
            walks=(),
            block=block,
            news=news,
            all_wait=news,
        )
        return cls(owners, frame, news, ReadBudget(budget, news), size, len(regions or whole))

    def push(
        self, runs: Sequence[Run], source: int = 0, last: bool = False, reached: tuple[int, int] | None = None
    ) -> None:
        """To all regions: what does not reach them is clipped. `reached` is the last run's own row unless told."""
        if reached is None:
            reached = (runs[-1].sheet, runs[-1].row) if runs else (0, 0)
        self.frame.push(source, batch_of(runs, self.budget, self.regions), *reached, last)

    def wait_until_complete(self) -> None:
        wait_until_complete(self.frame, self.news)

    def wait_until_all_wait(self) -> list[int]:
        """For what they wait, once nothing is decided any more."""
        heard = self.news.rung
        while not (awaited := self.frame.awaited):
            rung = self.news.wait(heard, PATIENCE)
            assert rung != heard or self.frame.awaited, "the owners go on for ever"
            heard = rung
        return awaited

    def pixels(self) -> Tensor:
        """As they stand: those of the regions."""
        _, _, width, height = self.frame.rectangle
        published = bytearray(self.owners.published(self.frame))
        return torch.frombuffer(published, dtype=torch.float32).reshape(height, width, 4)


def wait_until_complete(frame: SplatFrame, news: Bell) -> None:
    heard = news.rung
    while not frame.complete:
        rung = news.wait(heard, PATIENCE)
        assert rung != heard or frame.complete, f"nothing comes any more from {frame.awaited}"
        heard = rung


def batch_of(runs: Sequence[Run], budget: ReadBudget, regions: int = 1) -> BatchMemory:
    run_bytes, packets = batch_bytes(runs)
    part = (len(runs), len(packets) // 8)
    return BatchMemory((run_bytes + packets) * regions, [part] * regions, budget)


def splatted(
    runs: Sequence[Run],
    reach: PixelReach,
    order: Order,
    size: tuple[int, int],
    turned: bool = False,
    regions: Sequence[tuple[int, int]] | None = None,
    threads: int = 1,
    thresholds: Thresholds = TO_NEAREST,
    frozen_alpha: float = FROZEN_ALPHA,
) -> Tensor:
    """The finished image of these runs, which must be in order."""
    with owners(threads) as made:
        drawing = Drawing.begun(
            made, size, reach, order, turned, regions, thresholds=thresholds, frozen_alpha=frozen_alpha
        )
        drawing.push(runs, last=True)
        drawing.wait_until_complete()
        return drawing.pixels()


def even_regions(lines: int, count: int) -> list[tuple[int, int]]:
    """Bands of whole tiles, as many as there may be, up to this count."""
    edges = sorted({lines * n // count // 4 * 4 for n in range(count)})
    return list(zip(edges, [*edges[1:], lines], strict=True))
