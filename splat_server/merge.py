"""The merge as a state machine: events in, instructions out. It knows no socket, no thread and no clock.

All workers' batches become one sequence through the kernel's sorted linked list of buffers (paper: "Parallel
Implementation"). One frame runs at a time, and frame ids rise: batches of older frames are discarded, those of
newer ones held until their frame starts. A worker never goes back: what it sent for a frame that it has left before
that started is of no use any more, and a running frame that it leaves does without it, or might wait for ever. (An
honest worker leaves a frame because the client wants a newer one, which ends it here as well.)
"""

from dataclasses import dataclass
from typing import get_args

from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.splat_server._kernels import SortedBuffers
from volsplat.splat_server.merge_events import (
    BatchArrived,
    BufferedBatch,
    CompleteFrame,
    Event,
    FrameDropped,
    FrameId,
    FrameStarted,
    Instruction,
    MarkIncomplete,
    RefuseBatch,
    SplatSpans,
    SplatterReady,
    WorkerId,
    WorkerLinked,
    WorkerLost,
)

# Bytes buffered for one worker, beyond which its connection is held back: enough to bridge any pause of the network,
# and little enough that a worker hears of closed tiles before it has shaded what lies behind them.
CONNECTION_BUDGET = 8 << 20


@dataclass
class _RunningFrame:
    frame: FrameId
    workers: tuple[WorkerId, ...]  # in the kernel's order
    buffers: SortedBuffers
    batches: dict[int, tuple[WorkerId, BufferedBatch]]  # by the id that the kernel knows
    unfinished: set[WorkerId]
    lost: set[WorkerId]


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
        self._buffered: dict[WorkerId, int] = {}  # weight of batches, held ones included
        self._gone: set[WorkerId] = set()
        self._next_batch = 0

    def handle(self, event: Event) -> list[Instruction]:
        """Raises ValueError for an event that cannot happen here: a frame that starts twice or goes back."""
        instructions: list[Instruction] = HANDLERS[type(event)].method(self, event)
        return instructions

    @property
    def running_frame(self) -> FrameId | None:
        return self._running.frame if self._running else None

    @property
    def waits_for(self) -> WorkerId | None:
        """The worker without whose next batch the running frame cannot go on."""
        if self._running is None or self._running.buffers.waits_for < 0:
            return None
        return self._running.workers[self._running.buffers.waits_for]

    @property
    def unfinished(self) -> tuple[WorkerId, ...]:
        """Workers of the running frame whose last batch is still to come."""
        return tuple(self._running.unfinished) if self._running else ()

    def buffered_bytes(self, worker: WorkerId) -> int:
        return self._buffered.get(worker, 0)

    def may_read(self, worker: WorkerId) -> bool:
        """Whether to take more from the worker's connection.

        Budgets cannot deadlock: of the worker that the merge waits for nothing is buffered that the next
        SplatterReady does not release.
        """
        return self.buffered_bytes(worker) < CONNECTION_BUDGET

    @takes(FrameStarted)
    def _frame_started(self, event: FrameStarted) -> list[Instruction]:
        if event.frame <= self._newest:
            raise ValueError(f"frame {event.frame} cannot start after frame {self._newest}")
        if len(set(event.workers)) != len(event.workers):
            raise ValueError(f"frame {event.frame} names a worker twice")
        self._end_frame()
        self._newest = event.frame
        sheets, rows, samples = event.counts
        self._running = _RunningFrame(
            frame=event.frame,
            workers=event.workers,
            buffers=SortedBuffers(len(event.workers), sheets, rows, samples),
            batches={},
            unfinished=set(event.workers),
            lost=set(),
        )
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
        if worker not in running.workers:
            return self._refuse(worker, frame, "it has no part in this frame")
        try:
            running.buffers.push(
                running.workers.index(worker), self._next_batch, batch.memory, *batch.reached, batch.last
            )
        except ValueError as fault:
            return self._refuse(worker, frame, str(fault))
        running.batches[self._next_batch] = (worker, batch)
        self._next_batch += 1
        self._buffer(worker, batch.weight)
        if batch.last:
            running.unfinished.discard(worker)
        return []

    @takes(WorkerLost)
    def _worker_lost(self, event: WorkerLost) -> list[Instruction]:
        self._gone.add(event.worker)
        self._let_go(event.worker)
        self._lose(event.worker)
        return []

    @takes(WorkerLinked)
    def _worker_linked(self, event: WorkerLinked) -> list[Instruction]:
        self._gone.discard(event.worker)
        return []

    @takes(SplatterReady)
    def _splatter_ready(self, event: SplatterReady) -> list[Instruction]:
        running = self._running
        if running is None or event.frame != running.frame:
            return []
        alive = tuple(batch for _, batch in running.batches.values())
        spans, released, _, complete = running.buffers.advance(event.max_packets)
        instructions: list[Instruction] = []
        if spans.packets:
            instructions.append(SplatSpans(running.frame, spans, alive))
        self._release(running, released)
        if complete:
            lost = tuple(sorted(running.lost))
            instructions.append(MarkIncomplete(running.frame, lost) if lost else CompleteFrame(running.frame))
            self._running = None
        return instructions

    @takes(FrameDropped)
    def _frame_dropped(self, event: FrameDropped) -> list[Instruction]:
        self._newest = max(self._newest, event.frame)
        if self._running and self._running.frame <= event.frame:
            self._end_frame()
        self._taken_from_held(event.frame)
        return []

    def _refuse(self, worker: WorkerId, frame: FrameId, fault: str) -> list[Instruction]:
        instructions: list[Instruction] = [RefuseBatch(worker, frame, f"frame {frame}, worker {worker}: {fault}")]
        return instructions + self._worker_lost(WorkerLost(worker))

    def _lose(self, worker: WorkerId) -> None:
        """The running frame, if it is still waiting for the worker's last batch, must do without."""
        running = self._running
        if running is None or worker not in running.unfinished:
            return
        running.buffers.finish(running.workers.index(worker))
        running.unfinished.remove(worker)
        running.lost.add(worker)

    def _end_frame(self) -> None:
        """Let go of the running frame and all its buffers."""
        running, self._running = self._running, None
        if running is not None:
            self._release(running, list(running.batches))

    def _release(self, running: _RunningFrame, batches: list[int]) -> None:
        for batch_id in batches:
            worker, batch = running.batches.pop(batch_id)
            self._buffer(worker, -batch.weight)

    def _hold(self, worker: WorkerId, frame: FrameId, batch: BufferedBatch) -> None:
        """Keep a batch until its frame starts."""
        held = self._held.get(worker)
        if held is None or held.frame != frame:
            self._let_go(worker)
            held = self._held[worker] = _Held(frame, [])
        held.batches.append(batch)
        self._buffer(worker, batch.weight)

    def _let_go(self, worker: WorkerId) -> list[BufferedBatch]:
        """What was held of the worker."""
        held = self._held.pop(worker, None)
        batches = held.batches if held else []
        self._buffer(worker, -sum(batch.weight for batch in batches))
        return batches

    def _taken_from_held(self, frame: FrameId) -> list[tuple[WorkerId, list[BufferedBatch]]]:
        """Let go of what is held up to this frame; what is held for it is returned."""
        taken = [
            (worker, held.frame, self._let_go(worker))
            for worker, held in list(self._held.items())
            if held.frame <= frame
        ]
        return [(worker, batches) for worker, held_for, batches in taken if held_for == frame]

    def _buffer(self, worker: WorkerId, weight: int) -> None:
        """Count what was taken from a worker, or what it has back."""
        buffered = self.buffered_bytes(worker) + weight
        if buffered:
            self._buffered[worker] = buffered
        else:
            self._buffered.pop(worker, None)

    def validate_state(self) -> None:
        """Raises AssertionError or RuntimeError where an invariant is broken."""
        running = self._running
        of_running = list(running.batches.values()) if running else []
        of_held = [(worker, batch) for worker, held in self._held.items() for batch in held.batches]
        buffered: dict[WorkerId, int] = {}
        for worker, batch in of_running + of_held:
            buffered[worker] = buffered.get(worker, 0) + batch.weight
        assert self._buffered == buffered, "bytes are miscounted"
        assert all(held.frame > self._newest for held in self._held.values()), "held for a frame that has started"
        assert not self._gone & self._held.keys(), "batches of a worker that is gone are held"
        if running is None:
            return
        running.buffers.validate()
        assert running.frame == self._newest, "an old frame runs"
        assert running.unfinished <= set(running.workers), "a stranger is awaited"
        assert not running.lost & running.unfinished, "a lost worker is awaited"
        assert not self._gone & running.unfinished, "a worker that is gone is awaited"
        assert all(worker in running.workers for worker, _ in running.batches.values()), "a stranger's batch was taken"
        assert self.waits_for is None or self.waits_for in running.unfinished, "a finished worker is waited for"
        waits_for = self.waits_for
        of_waited = any(worker == waits_for for worker, _ in of_running)  # which will be released
        assert waits_for is None or self.may_read(waits_for) or of_waited, "the merge deadlocks"
        assert not self._held.keys() & running.unfinished, "a worker that has gone on is awaited"


HANDLERS = handlers(Merge)

check_handlers(get_args(Event), Merge)
