"""The merge's state machine: whose batches make up a frame, whatever comes early, late or not at all."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field

import pytest

from support.scenes.owned import UNBOUNDED, Drawing, batch_of, owners
from support.scenes.row_runs import Dot, Run
from volsplat.splat_server._kernels import Bell, Owners, ReadBudget
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import (
    BatchArrived,
    BufferedBatch,
    Event,
    FrameDropped,
    FrameStarted,
    PushBatch,
    RefuseBatch,
    WorkerLinked,
    WorkerLost,
)
from volsplat.splat_server.worker_links import carried_out

COUNTS = (3, 4, 12)
SIZE = (32, 32)


def run(sheet: int, row: int) -> Run:
    return Run(sheet, row, 0, (Dot(640, 640, 9, (1, 2, 3)),))


@dataclass
class Merging:
    """A merge, and the frames of which it is told."""

    made: Owners
    merge: Merge = field(default_factory=Merge)
    budgets: dict[int, ReadBudget] = field(default_factory=dict)
    drawing: Drawing | None = None

    def starts(self, frame: int, workers: Mapping[int, int]) -> list[RefuseBatch]:
        self.drawing = Drawing.begun(self.made, SIZE, None, sources=sum(workers.values()), counts=COUNTS)
        return self.handle(FrameStarted(frame, workers, self.drawing.frame))

    def sends(
        self,
        worker: int,
        frame: int,
        *runs: Run,
        last: bool = False,
        reached: tuple[int, int] = (0, 0),
        walker: int = 0,
    ) -> list[RefuseBatch]:
        budget = self.budgets.setdefault(worker, ReadBudget(UNBOUNDED, Bell()))
        batch = BufferedBatch(walker, batch_of(runs, budget), reached, last)
        return self.handle(BatchArrived(worker, frame, batch))

    def handle(self, event: Event) -> list[RefuseBatch]:
        return carried_out(self.merge.handle(event))

    @property
    def packets(self) -> int:
        """Of the newest frame, once it can do no more."""
        assert self.drawing is not None
        heard = self.drawing.news.rung
        while not self.drawing.frame.complete and not self.drawing.frame.awaited:
            heard = self.drawing.news.wait(heard, 1.0)
        return self.drawing.frame.packets

    @property
    def complete(self) -> bool:
        return self.packets >= 0 and self.drawing is not None and self.drawing.frame.complete

    def held(self, worker: int) -> int:
        return self.budgets[worker].held


@pytest.fixture
def merging() -> Iterator[Merging]:
    with ExitStack() as stack:
        yield Merging(stack.enter_context(owners()))


def test_nothing_of_another_frame_reaches_the_image(merging: Merging) -> None:
    merging.starts(1, {0: 1, 1: 1})
    assert merging.sends(0, 1, run(0, 0)) == []
    for worker in (0, 1):
        assert merging.sends(worker, 2, run(1, worker)) == []
        assert merging.sends(worker, 2, run(2, worker), last=True) == []
    assert merging.held(0) > 0
    merging.starts(2, {0: 1, 1: 1})
    assert merging.sends(0, 1, run(0, 0)) == []
    assert merging.packets == 4 and merging.complete
    assert merging.held(0) == merging.held(1) == 0


def test_each_walker_of_a_worker_is_a_source_in_its_place(merging: Merging) -> None:
    merging.starts(1, {7: 2, 3: 1})
    frame = merging.drawing.frame if merging.drawing else None
    batch = BufferedBatch(1, batch_of([run(0, 0)], ReadBudget(1, Bell())), (0, 0), True)
    (push,) = merging.merge.handle(BatchArrived(7, 1, batch))
    assert push == PushBatch(7, 1, frame, 1, batch)  # type: ignore[arg-type]
    assert merging.merge.unfinished({3, 5, 7}) == [7, 3]
    merging.sends(7, 1, run(0, 0), last=True)
    assert merging.merge.awaits(3) is False or merging.packets == 1
    merging.sends(3, 1, last=True)
    assert merging.packets == 1 and merging.merge.awaits(7) and not merging.merge.awaits(3)
    assert merging.merge.unfinished({3, 7}) == [7]
    (refused,) = merging.sends(3, 1, walker=1)
    assert refused.fault == "frame 1, worker 3: walker 1 has no part in this frame"
    merging.sends(7, 1, run(1, 0), last=True, walker=1)
    assert merging.packets == 2 and merging.complete and merging.merge.lost == []


def test_a_lost_worker_leaves_the_frame_incomplete_but_not_hanging(merging: Merging) -> None:
    merging.starts(1, {7: 1, 8: 2})
    merging.sends(7, 1, run(0, 0), run(2, 0), last=True)
    merging.sends(8, 1, run(1, 0), reached=(1, 0))
    merging.sends(8, 1, walker=1, last=True)
    assert merging.packets == 2 and merging.merge.awaits(8)
    merging.handle(WorkerLost(8))
    assert merging.packets == 3 and merging.complete and merging.merge.lost == [8]


def test_a_worker_lost_after_its_last_batch_is_not_missed(merging: Merging) -> None:
    merging.starts(1, {7: 1})
    merging.sends(7, 1, run(0, 0), last=True)
    merging.handle(WorkerLost(7))
    assert merging.complete and merging.merge.lost == []


def test_a_worker_lost_before_the_frame_is_not_waited_for(merging: Merging) -> None:
    merging.handle(WorkerLost(7))
    merging.starts(1, {7: 1, 8: 1})
    merging.sends(8, 1, last=True)
    assert merging.complete and merging.merge.lost == [7]


def test_a_worker_that_links_again_is_waited_for_from_the_next_frame_on(merging: Merging) -> None:
    merging.starts(1, {7: 1})
    merging.handle(WorkerLost(7))
    merging.handle(WorkerLinked(7))
    assert merging.sends(7, 1, run(0, 0), last=True) == []
    assert merging.complete and merging.merge.lost == [7] and merging.packets == 0
    merging.starts(2, {7: 1})
    assert not merging.complete and merging.merge.awaits(7)
    merging.sends(7, 2, run(0, 0), last=True)
    assert merging.complete and merging.packets == 1


def test_a_frame_without_workers_or_samples_completes(merging: Merging) -> None:
    merging.starts(1, {})
    assert merging.complete
    merging.starts(2, {4: 1})
    merging.sends(4, 2, last=True)
    assert merging.complete


def test_a_dropped_frame_lets_go_of_everything(merging: Merging) -> None:
    merging.starts(3, {1: 1})
    merging.sends(1, 3, run(0, 0))
    merging.sends(1, 4, run(0, 0))
    merging.handle(FrameDropped(4))
    merging.made.clear(*SIZE, False)
    merging.drawing = None
    assert merging.held(1) == 0 and merging.merge.unfinished({1}) == []
    for frame in (3, 4):
        assert merging.sends(1, frame, run(0, 0)) == []
    assert merging.held(1) == 0


def test_a_batch_that_breaks_the_rules_is_refused(merging: Merging) -> None:
    merging.starts(1, {1: 1, 2: 1})
    [refused] = merging.sends(1, 1, run(99, 0), last=True)
    assert refused.fault.startswith("frame 1, worker 1: run 0 at (sheet 99, row 0, sample 0)")
    merging.handle(WorkerLost(1))  # as its link is closed
    assert merging.sends(1, 1, run(0, 0)) == []
    [stranger] = merging.sends(9, 1, run(0, 0))
    assert stranger.fault == "frame 1, worker 9: it has no part in this frame"
    merging.sends(2, 1, run(0, 0), last=True)
    assert merging.complete and merging.merge.lost == [1] and merging.packets == 1
    assert merging.held(1) == 0


def test_a_batch_that_came_early_and_breaks_the_rules_is_refused_when_its_frame_starts(merging: Merging) -> None:
    merging.sends(1, 1, run(99, 0))
    [refused] = merging.starts(1, {1: 1})
    assert refused.worker == 1 and "sheet 99" in refused.fault


def test_frames_only_go_forward(merging: Merging) -> None:
    merging.starts(2, {1: 1})
    with pytest.raises(ValueError, match="frame 2 cannot start after frame 2"):
        merging.starts(2, {1: 1})


@pytest.mark.parametrize("begun", [True, False])
def test_a_frame_does_without_a_worker_that_has_gone_on_to_a_newer_one(merging: Merging, begun: bool) -> None:
    """Or it would wait for ever, where nobody asks for the newer one."""
    if begun:
        merging.starts(1, {1: 1, 2: 1})
    merging.sends(1, 2, run(0, 0), last=True)
    if not begun:
        merging.starts(1, {1: 1, 2: 1})
    merging.sends(2, 1, run(1, 0), last=True)
    assert merging.complete and merging.merge.lost == [1]
    merging.starts(2, {1: 1})
    assert merging.complete and merging.packets == 1


@pytest.mark.parametrize("same_frame", [True, False])
def test_of_what_comes_too_early_only_the_newest_frame_s_is_kept(merging: Merging, same_frame: bool) -> None:
    """Empty batches of frames that nobody asked for."""
    merging.starts(1, {1: 1, 2: 1})
    merging.sends(1, 7)
    of_one = merging.held(1)
    for n in range(1, 100):
        merging.sends(1, 7 if same_frame else 7 + n)
    assert merging.held(1) == (100 * of_one if same_frame else of_one) > 0
    merging.handle(WorkerLost(1))
    assert merging.held(1) == 0
    merging.sends(2, 1, run(0, 0), last=True)
    assert merging.complete and merging.merge.lost == [1]


def test_empty_batches_of_the_running_frame_are_let_go_of(merging: Merging) -> None:
    merging.starts(1, {1: 1})
    for _ in range(500):
        merging.sends(1, 1)
        assert merging.held(1) == 0


def test_a_worker_does_not_go_back_to_a_frame_that_it_has_left(merging: Merging) -> None:
    merging.starts(1, {1: 1, 2: 1})
    merging.sends(1, 3)
    [refused] = merging.sends(1, 1, run(0, 0))
    assert refused.fault == "frame 1, worker 1: it had gone on to frame 3"
    merging.sends(2, 1, last=True)
    assert merging.complete and merging.merge.lost == [1]
