"""What the merge is told, and what it tells: the events and instructions of merge.Merge."""

from collections.abc import Mapping
from dataclasses import dataclass

from volsplat.splat_server._kernels import BatchMemory, SplatFrame

WorkerId = int
FrameId = int


@dataclass(frozen=True)
class BufferedBatch:
    """What a walker sent: nothing that it sends later lies before `reached`, and after `last` nothing comes."""

    walker: int
    memory: BatchMemory
    reached: tuple[int, int]  # sheet, row
    last: bool


# Events


@dataclass(frozen=True)
class FrameStarted:
    frame: FrameId
    workers: Mapping[WorkerId, int]  # with their walkers: the sources of the frame, in this order
    into: SplatFrame


@dataclass(frozen=True)
class BatchArrived:
    worker: WorkerId
    frame: FrameId
    batch: BufferedBatch


@dataclass(frozen=True)
class WorkerWentOn:
    """The worker sends a later frame's batches, which are not taken before that has started."""

    worker: WorkerId
    frame: FrameId


@dataclass(frozen=True)
class WorkerLost:
    """The worker's link has ended. The running frame does without it, and so do later ones until it links again."""

    worker: WorkerId


@dataclass(frozen=True)
class WorkerLinked:
    """The worker has a link. If it was lost before, frames that start from now on wait for it again."""

    worker: WorkerId


@dataclass(frozen=True)
class FrameDropped:
    frame: FrameId


Event = FrameStarted | BatchArrived | WorkerWentOn | WorkerLost | WorkerLinked | FrameDropped


# Instructions


@dataclass(frozen=True)
class PushBatch:
    """Hand the batch to the owners of the frame's regions, after those of the worker that came before."""

    worker: WorkerId
    frame: FrameId
    into: SplatFrame
    source: int
    batch: BufferedBatch

    def carry_out(self) -> None:
        """Raises ValueError naming the fault if the batch breaks the rules."""
        self.into.push(self.source, self.batch.memory, *self.batch.reached, self.batch.last)


@dataclass(frozen=True)
class RefuseBatch:
    """The batch breaks the rules: the worker's connection must be closed. For the merge the worker is lost."""

    worker: WorkerId
    frame: FrameId
    fault: str


Instruction = PushBatch | RefuseBatch
