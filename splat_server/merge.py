"""The merge as a state machine: events in, instructions out. It knows no socket, no thread and no clock.

All workers' batches become one sequence through the kernel's sorted linked list of buffers (paper: "Parallel
Implementation"). One frame runs at a time, and frame ids rise: batches of older frames are discarded, those of
newer ones held until their frame starts.
"""

from dataclasses import dataclass

from volsplat.splat_server._kernels import SortedBuffers
from volsplat.splat_server.merge_events import (
    Batch,
    BatchArrived,
    CompleteFrame,
    Event,
    FrameAborted,
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
    batches: dict[int, tuple[WorkerId, Batch]]  # by the id that the kernel knows
    unfinished: set[WorkerId]
    lost: set[WorkerId]


class Merge:
    """State of the merge over all frames. `handle` takes an event and returns what is to be done, in order."""

    def __init__(self) -> None:
        self._newest: FrameId = -1  # the greatest frame that has started
        self._running: _RunningFrame | None = None
        self._held: dict[FrameId, list[tuple[WorkerId, Batch]]] = {}
        self._buffered: dict[WorkerId, int] = {}  # bytes, held ones included
        self._gone: set[WorkerId] = set()
        self._next_batch = 0

    def handle(self, event: Event) -> list[Instruction]:
        """Raises ValueError for an event that cannot happen here: a frame that starts twice or goes back."""
        handler = getattr(self, f"_handle_{_snake_case(type(event).__name__)}")
        instructions: list[Instruction] = handler(event)
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

        The worker that the merge waits for is always read, so that budgets cannot deadlock; it has nothing of this
        frame buffered. Only one that has gone on to newer frames, whose start will come, is held to its budget.
        """
        if self.buffered_bytes(worker) < CONNECTION_BUDGET:
            return True
        return worker == self.waits_for and not any(held == worker for held, _ in self._all_held())

    def _handle_frame_started(self, event: FrameStarted) -> list[Instruction]:
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
        for worker, batch in self._taken_from_held(event.frame):
            instructions += self._handle_batch_arrived(BatchArrived(worker, event.frame, batch))
        for worker in sorted(self._gone.intersection(event.workers)):
            self._lose(worker)
        return instructions

    def _handle_batch_arrived(self, event: BatchArrived) -> list[Instruction]:
        worker, frame, batch = event.worker, event.frame, event.batch
        if frame > self._newest:
            self._held.setdefault(frame, []).append((worker, batch))
            self._buffered[worker] = self.buffered_bytes(worker) + batch.memory.bytes
            return []
        running = self._running
        if running is None or frame != running.frame or worker in self._gone or worker in running.lost:
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
        self._buffered[worker] = self.buffered_bytes(worker) + batch.memory.bytes
        if batch.last:
            running.unfinished.discard(worker)
        return []

    def _handle_worker_lost(self, event: WorkerLost) -> list[Instruction]:
        self._gone.add(event.worker)
        self._lose(event.worker)
        return []

    def _handle_worker_linked(self, event: WorkerLinked) -> list[Instruction]:
        self._gone.discard(event.worker)
        return []

    def _handle_splatter_ready(self, event: SplatterReady) -> list[Instruction]:
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

    def _handle_frame_aborted(self, event: FrameAborted) -> list[Instruction]:
        self._newest = max(self._newest, event.frame)
        if self._running and self._running.frame <= event.frame:
            self._end_frame()
        self._taken_from_held(event.frame)
        return []

    def _refuse(self, worker: WorkerId, frame: FrameId, fault: str) -> list[Instruction]:
        instructions: list[Instruction] = [RefuseBatch(worker, frame, f"frame {frame}, worker {worker}: {fault}")]
        return instructions + self._handle_worker_lost(WorkerLost(worker))

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
            self._buffered[worker] -= batch.memory.bytes

    def _taken_from_held(self, frame: FrameId) -> list[tuple[WorkerId, Batch]]:
        """Let go of what is held up to this frame; what is held for it is returned, in order of arrival."""
        taken: list[tuple[WorkerId, Batch]] = []
        for held_for in [held_for for held_for in self._held if held_for <= frame]:
            batches = self._held.pop(held_for)
            for worker, batch in batches:
                self._buffered[worker] -= batch.memory.bytes
            taken += batches if held_for == frame else []
        return taken

    def _all_held(self) -> list[tuple[WorkerId, Batch]]:
        return [entry for held in self._held.values() for entry in held]

    def validate_state(self) -> None:
        """Raises AssertionError or RuntimeError where an invariant is broken."""
        buffered: dict[WorkerId, int] = {}
        running = self._running
        for worker, batch in (list(running.batches.values()) if running else []) + self._all_held():
            buffered[worker] = buffered.get(worker, 0) + batch.memory.bytes
        counted = {worker: size for worker, size in self._buffered.items() if size}
        assert counted == {worker: size for worker, size in buffered.items() if size}, "bytes are miscounted"
        assert all(frame > self._newest for frame in self._held), "a batch is held for a frame that has started"
        if running is None:
            return
        running.buffers.validate()
        assert running.frame == self._newest, "an old frame runs"
        assert running.unfinished <= set(running.workers), "a stranger is awaited"
        assert not running.lost & running.unfinished, "a lost worker is awaited"
        assert not self._gone & running.unfinished, "a worker that is gone is awaited"
        assert all(worker in running.workers for worker, _ in running.batches.values()), "a stranger's batch was taken"
        assert self.waits_for is None or self.waits_for in running.unfinished, "a finished worker is waited for"
        assert self.waits_for is None or self.may_read(self.waits_for) or self._held, "the merge deadlocks"


def _snake_case(name: str) -> str:
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_")
