"""One frame's way from batches to the published image: the stage that splat server and single process share."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from threading import Lock
from time import perf_counter

from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.splat_server._kernels import BatchMemory
from volsplat.splat_server.edge_layers import edge_layers
from volsplat.splat_server.image_buffer import ImageBuffer
from volsplat.splat_server.merge import Merge
from volsplat.splat_server.merge_events import (
    BatchArrived,
    BufferedBatch,
    CompleteFrame,
    Event,
    FrameStarted,
    Instruction,
    MarkIncomplete,
    RefuseBatch,
    SplatSpans,
    SplatterReady,
)
from volsplat.splat_server.pixel_reach import busy_rows, pixel_reach, pixels_reached


@dataclass(frozen=True)
class Progress:
    """What `FrameAssembly.advance` did."""

    packets: int  # that this call had splatted
    waits_for: int | None  # the worker whose batch is needed to go on
    complete: bool  # nothing more is to come
    lost: tuple[int, ...]  # workers that were lost before their last batch: the image is incomplete


class Idle:
    """A clock that stands still while something is splatted."""

    def __init__(self, assembly: "FrameAssembly") -> None:
        self._assembly = assembly
        self._began = self._now()

    @property
    def seconds(self) -> float:
        """Since this was made."""
        return max(0.0, self._now() - self._began)  # two clocks are not read at once

    def _now(self) -> float:
        return perf_counter() - self._assembly.seconds_in_splat


class FrameAssembly:
    """Merges and splats one frame.

    Any thread may bring batches; one at a time may `advance` and ask for what is `published`. `merge` and
    its `lock` are a server's, which outlive the frame; without them the assembly has its own.
    """

    def __init__(
        self,
        plan: FramePlan,
        frame: int,
        workers: Sequence[int],
        image: ImageBuffer | None = None,
        merge: Merge | None = None,
        lock: AbstractContextManager[object] | None = None,
        threads: int = 1,
    ) -> None:
        """Clears `image` and uses it if it suits the plan, else closes it. Raises BadInput for a bad plan."""
        self.plan = plan
        self.frame = frame
        self.complete = False
        self.lost: tuple[int, ...] = ()
        self.packets = 0
        self._finished: memoryview | None = None  # the complete image, which the buffer has handed out
        self.seconds_in_merge = 0.0  # while nothing was splatted
        self._reach = pixel_reach(plan)
        self.pixels_per_packet = pixels_reached(self._reach, plan)
        self._layers = edge_layers(plan.edges, *plan.image_size) if plan.edges else None
        if image is None or (image.width, image.height) != plan.image_size:
            before, image = image, ImageBuffer(*plan.image_size, threads)
            if before is not None:
                before.close()
        image.clear(plan.turned, busy_rows(plan, self._reach))
        self.image = image
        self._busy_before = image.busy_seconds
        self.merge = merge or Merge()
        self._lock: AbstractContextManager[object] = lock or Lock()  # guards the merge
        sheet, row, sample = (plan.visits[axis].count for axis in plan.traversal.axes)
        begun = self._handle(FrameStarted(frame, tuple(workers), (sheet, row, sample)))
        # Batches that came early and break this frame's rules. Their workers now count as lost.
        self.refused = tuple(instruction for instruction in begun if isinstance(instruction, RefuseBatch))

    def arrived(self, worker: int, runs: object, packets: object, reached: tuple[int, int], last: bool) -> None:
        """Take a batch of this frame: row runs and packets as any contiguous CPU memory (see protocol.packet_layout).

        The memory is pinned and must not change until the batch is splatted.
        Raises RemoteProtocolError where the batch breaks the rules.
        """
        try:
            memory = BatchMemory(runs, packets)
        except ValueError as fault:
            raise RemoteProtocolError(f"frame {self.frame}, worker {worker}: {fault}") from None
        for instruction in self._handle(BatchArrived(worker, self.frame, BufferedBatch(memory, reached, last))):
            if isinstance(instruction, RefuseBatch):
                raise RemoteProtocolError(instruction.fault)

    def advance(self, max_packets: int = 1 << 17) -> Progress:
        """Have splatted what is decided of the order, about `max_packets` of it; splats where much is unfinished.

        Once the frame is complete all of it is splatted.
        """
        idle = Idle(self)
        instructions = self._handle(SplatterReady(self.frame, max_packets))
        self.seconds_in_merge += idle.seconds
        packets = 0
        for instruction in instructions:
            match instruction:
                case SplatSpans(spans=spans, keeps_alive=batches):
                    self.image.splat(spans, self._reach, self.plan.order, self.pixels_per_packet, batches)
                    packets += spans.packets
                case CompleteFrame():
                    self._finish()
                case MarkIncomplete(lost=lost):
                    self._finish()
                    self.lost = lost
        self.packets += packets
        with self._lock:
            waits_for = self.merge.waits_for if self.merge.running_frame == self.frame else None
        return Progress(packets, waits_for, self.complete, self.lost)

    def abort(self) -> None:
        """Drop what is still to be splatted."""
        self.image.cancel()

    @property
    def splatting(self) -> bool:
        """Whether anything handed to the splatter is unfinished."""
        return self.image.busy

    @property
    def seconds_in_splat(self) -> float:
        """For how long there has been something to splat."""
        return self.image.busy_seconds - self._busy_before

    @property
    def hidden_packets(self) -> int:
        """How many of them were left out as hidden (see ImageBuffer.hidden_packets)."""
        return self.image.hidden_packets

    def published(self) -> memoryview:
        """The image as it stands, edges included: height x width x 4 float32, little endian, associated alpha."""
        if self._finished is not None:
            return self._finished
        return self.image.published(*self._layers) if self._layers else self.image.snapshot()

    def _finish(self) -> None:
        if self._layers:
            self.image.finish()
        else:
            self._finished = self.image.hand_out()
        self.complete = True

    def _handle(self, event: Event) -> list[Instruction]:
        with self._lock:
            return self.merge.handle(event)
