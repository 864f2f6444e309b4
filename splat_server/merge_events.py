"""What the merge is told, and what it tells: the events and instructions of merge.Merge."""

from dataclasses import dataclass

from volsplat.splat_server._kernels import BatchMemory, SpanList

WorkerId = int
FrameId = int

BATCH_OVERHEAD = 8 << 10  # bytes that a batch costs beside its own, at most: objects, and the rounding of its buffer


@dataclass(frozen=True)
class BufferedBatch:
    """What a worker sent: nothing that it sends later lies before `reached`, and after `last` nothing comes."""

    memory: BatchMemory
    reached: tuple[int, int]  # sheet, row
    last: bool

    @property
    def weight(self) -> int:
        """Bytes of memory that it takes; an empty one takes some as well."""
        return self.memory.bytes + BATCH_OVERHEAD


# Events


@dataclass(frozen=True)
class FrameStarted:
    frame: FrameId
    workers: tuple[WorkerId, ...]
    counts: tuple[int, int, int]  # visited samples along the sheet, row and sample axes


@dataclass(frozen=True)
class BatchArrived:
    worker: WorkerId
    frame: FrameId
    batch: BufferedBatch


@dataclass(frozen=True)
class WorkerLost:
    """The worker's link has ended. The running frame does without it, and so do later ones until it links again."""

    worker: WorkerId


@dataclass(frozen=True)
class WorkerLinked:
    """The worker has a link. If it was lost before, frames that start from now on wait for it again."""

    worker: WorkerId


@dataclass(frozen=True)
class SplatterReady:
    """The splatter has done what it was given and asks for about this many packets more."""

    frame: FrameId
    max_packets: int


@dataclass(frozen=True)
class FrameDropped:
    frame: FrameId


Event = FrameStarted | BatchArrived | WorkerLost | WorkerLinked | SplatterReady | FrameDropped


# Instructions


@dataclass(frozen=True)
class SplatSpans:
    frame: FrameId
    spans: SpanList
    keeps_alive: tuple[BufferedBatch, ...]  # the memory that the spans lie in


@dataclass(frozen=True)
class CompleteFrame:
    frame: FrameId


@dataclass(frozen=True)
class MarkIncomplete:
    """All that will come has been splatted, but these workers were lost before their last batch."""

    frame: FrameId
    lost: tuple[WorkerId, ...]


@dataclass(frozen=True)
class RefuseBatch:
    """The batch breaks the rules: the worker's connection must be closed. For the merge the worker is lost."""

    worker: WorkerId
    frame: FrameId
    fault: str


Instruction = SplatSpans | CompleteFrame | MarkIncomplete | RefuseBatch
