"""Which batches make up a frame, as a state machine: events in, instructions out. It knows no socket and no clock.

The owners of the frame's regions merge what is pushed (paper: "Parallel Implementation"); here it is decided whose
batches these are. One frame runs at a time, and frame ids rise: batches of older frames are discarded, those of
newer ones held until their frame starts. A worker never goes back: what it sent for a frame that it has left before
that started is of no use any more, and a running frame that it leaves does without it, or might wait for ever. (An
honest worker leaves a frame because the client wants a newer one, which ends it here as well.)
"""

from collections.abc import Set
from dataclasses import dataclass, field
from itertools import accumulate
from typing import get_args

from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.splat_server._kernels import SplatFrame
from volsplat.splat_server.merge_events import (
    BatchArrived,
    BufferedBatch,
    Event,
    FrameDropped,
    FrameId,
    FrameStarted,
    Instruction,
    PushBatch,
    RefuseBatch,
    WorkerId,
    WorkerLinked,
    WorkerLost,
    WorkerWentOn,
)


@dataclass
class _RunningFrame:
    frame: FrameId
    sources: dict[WorkerId, range]  # of each worker's walkers
    into: SplatFrame
    lost: set[WorkerId] = field(default_factory=set)

    def finished(self, worker: WorkerId) -> bool:
        return all(map(self.into.finished, self.sources[worker]))


@dataclass(frozen=True)
class WorkerPart:
    """A worker's part in the newest frame."""

    frame: FrameId
    into: SplatFrame | None  # none if its batches are of no use
    sources: range  # one for each of its walkers


@dataclass
class _Held:
    """Batches of one worker for a frame that has not started."""

    frame: FrameId
    batches: list[BufferedBatch]


class Merge:
    """State of the merge over all frames. `handle` takes an event and returns what is to be done, in order."""

    def __init__(self) -> None:
        self._newest: FrameId = -1  # the greatest frame that has started
        self._running: _RunningFrame | None = None
        self._held: dict[WorkerId, _Held] = {}
        self._gone: set[WorkerId] = set()

    def handle(self, event: Event) -> list[Instruction]:
        """Raises ValueError for an event that cannot happen here: a frame that starts twice or goes back."""
        instructions: list[Instruction] = HANDLERS[type(event)].method(self, event)
        return instructions

    def unfinished(self, workers: Set[WorkerId]) -> list[WorkerId]:
        """Those of them of whom something of the running frame is still to come."""
        running = self._running
        if running is None:
            return []
        return [worker for worker in running.sources if worker in workers and not running.finished(worker)]

    @property
    def lost(self) -> list[WorkerId]:
        """Workers that the running frame must do without: their last batches will not come."""
        return sorted(self._running.lost) if self._running else []

    def awaits(self, worker: WorkerId) -> bool:
        """Whether nothing of the running frame can be splatted before more has come from the worker."""
        running = self._running
        if running is None or worker not in running.sources:
            return False
        return not set(running.into.awaited).isdisjoint(running.sources[worker])

    def part_of(self, worker: WorkerId) -> WorkerPart:
        """Where batches of the newest frame go, whoever takes them past here."""
        running = self._running
        if running is None or worker in running.lost:
            return WorkerPart(self._newest, None, range(0))
        return WorkerPart(self._newest, running.into, running.sources.get(worker, range(0)))

    @takes(FrameStarted)
    def _frame_started(self, event: FrameStarted) -> list[Instruction]:
        if event.frame <= self._newest:
            raise ValueError(f"frame {event.frame} cannot start after frame {self._newest}")
        self._newest = event.frame
        ends = accumulate(event.workers.values())
        sources = {
            worker: range(end - walkers, end)
            for (worker, walkers), end in zip(event.workers.items(), ends, strict=True)
        }
        self._running = _RunningFrame(event.frame, sources, event.into)
        instructions: list[Instruction] = []
        for worker, batches in self._taken_from_held(event.frame):
            for batch in batches:
                instructions += self._batch_arrived(BatchArrived(worker, event.frame, batch))
        for worker in sorted((self._gone | self._held.keys()).intersection(event.workers)):
            self._lose(worker)
        return instructions

    @takes(BatchArrived)
    def _batch_arrived(self, event: BatchArrived) -> list[Instruction]:
        worker, frame, batch = event.worker, event.frame, event.batch
        if worker in self._gone:
            return []
        held = self._held.get(worker)
        if held is not None and frame < held.frame:
            return self._refuse(worker, frame, f"it had gone on to frame {held.frame}")
        if frame > self._newest:
            self._hold(worker, frame, batch)
            self._lose(worker)
            return []
        running = self._running
        if running is None or frame != running.frame or worker in running.lost:
            return []
        if worker not in running.sources:
            return self._refuse(worker, frame, "it has no part in this frame")
        if batch.walker >= len(running.sources[worker]):
            return self._refuse(worker, frame, f"walker {batch.walker} has no part in this frame")
        return [PushBatch(worker, frame, running.into, running.sources[worker][batch.walker], batch)]

    @takes(WorkerWentOn)
    def _worker_went_on(self, event: WorkerWentOn) -> list[Instruction]:
        if event.frame > self._newest:
            self._lose(event.worker)
        return []

    @takes(WorkerLost)
    def _worker_lost(self, event: WorkerLost) -> list[Instruction]:
        self._gone.add(event.worker)
        self._held.pop(event.worker, None)
        self._lose(event.worker)
        return []

    @takes(WorkerLinked)
    def _worker_linked(self, event: WorkerLinked) -> list[Instruction]:
        self._gone.discard(event.worker)
        return []

    @takes(FrameDropped)
    def _frame_dropped(self, event: FrameDropped) -> list[Instruction]:
        self._newest = max(self._newest, event.frame)
        if self._running and self._running.frame <= event.frame:
            self._running = None
        self._taken_from_held(event.frame)
        return []

    def _refuse(self, worker: WorkerId, frame: FrameId, fault: str) -> list[Instruction]:
        instructions: list[Instruction] = [RefuseBatch(worker, frame, f"frame {frame}, worker {worker}: {fault}")]
        return instructions + self._worker_lost(WorkerLost(worker))

    def _lose(self, worker: WorkerId) -> None:
        """The running frame, if anything is still to come from the worker, must do without."""
        running = self._running
        if running is None or worker not in running.sources or running.finished(worker):
            return
        running.lost.add(worker)
        for source in running.sources[worker]:
            running.into.finish(source)

    def _hold(self, worker: WorkerId, frame: FrameId, batch: BufferedBatch) -> None:
        """Keep a batch until its frame starts."""
        held = self._held.get(worker)
        if held is None or held.frame != frame:
            held = self._held[worker] = _Held(frame, [])
        held.batches.append(batch)

    def _taken_from_held(self, frame: FrameId) -> list[tuple[WorkerId, list[BufferedBatch]]]:
        """Let go of what is held up to this frame; what is held for it is returned."""
        taken = [(worker, held) for worker, held in self._held.items() if held.frame <= frame]
        for worker, _ in taken:
            del self._held[worker]
        return [(worker, held.batches) for worker, held in taken if held.frame == frame]


HANDLERS = handlers(Merge)

check_handlers(get_args(Event), Merge)
