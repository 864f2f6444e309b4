"""The single-processor version: the servers' very stages in one process, with no sockets.

The only file that imports both servers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from volsplat.client.caller.arguments import (
    checked_count,
    checked_number,
    checked_scene,
    checked_step,
    checked_volume,
)
from volsplat.client.coordinator.base_level import budgets
from volsplat.client.coordinator.coordinator_events import (
    FrameOutcome,
    Instruction,
    MessageReceived,
    ReportProgress,
    Send,
)
from volsplat.client.coordinator.packing import Packing
from volsplat.client.coordinator.volume_holding import VolumeHolding
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.session.renderer import PARTIAL_INTERVAL, Refinement, StepOutcome, refined
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.mapshade_server.frame_tally import FrameTally
from volsplat.mapshade_server.frame_walk import FrameWalk, ShadedBatch
from volsplat.mapshade_server.held_volume import Answer, HeldVolume
from volsplat.mapshade_server.probe import front_most
from volsplat.program.available_memory import available_memory
from volsplat.program.peak_memory import peak_memory
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import handlers
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.levels import Resolution
from volsplat.protocol.rules.line_of_sight import line_of_sight
from volsplat.protocol.rules.shading_rule import shading_rule
from volsplat.protocol.text.errors import BadInput
from volsplat.splat_server.frame_assembly import FrameAssembly, Idle
from volsplat.splat_server.image_buffer import ImageBuffer

if TYPE_CHECKING:
    from torch import Tensor

WORKER = 1  # the one map/shade "server"
WALKED_APART_FROM = 4  # threads
TAKEN = handlers(VolumeHolding)


class Superseded(Exception):
    """Another frame was drawn since; nothing is left of this one."""


class SingleProcess:
    """A volume held and drawn by this process alone: the same images as a Session's, bit for bit."""

    def __init__(
        self,
        volume: str | Path,
        *,
        threads: int = 1,
        memory: int | None = None,
        on_progress: Callable[[str], None] | None = None,
    ) -> None:
        """Read and survey the volume. Raises BadInput.

        `threads` share out stripes of the image and splat; one of them walks and merges as well. From
        WALKED_APART_FROM on another thread walks, since a third of a frame is too much for one of so many.
        `memory` is how many bytes of a prepared volume may be held; by default half of what the machine has left.
        """
        name = checked_volume(volume)
        memory = None if memory is None else checked_count(memory, "memory")
        threads = checked_count(threads, "threads")
        self._say = on_progress or (lambda text: None)
        self._threads = threads
        self._walker = ThreadPoolExecutor(1, "walk") if threads >= WALKED_APART_FROM else None
        self._held = HeldVolume()
        self._holding = VolumeHolding()
        left = budgets({WORKER: available_memory()}, {WORKER: "here"})
        self._carry_out(self._holding.begin(name, left if memory is None else {WORKER: memory}))
        self._image: ImageBuffer | None = None
        self._frame = 0
        self._ahead: Future[ShadedBatch | None] | None = None  # the batch that the walker is at

    @property
    def volume(self) -> SurveyedVolume:
        """What is known of the volume."""
        assert self._holding.volume is not None
        return self._holding.volume

    def render(self, scene: Scene, step: Step = Step.F) -> Tensor:
        """The finished image of one step, (H, W, 4) float32, associated alpha. Raises BadInput, also without torch."""
        return self.finish(scene, step).image

    def finish(self, scene: Scene, step: Step = Step.F) -> Refinement:
        """As `render`, with what it took."""
        scene, step = checked_scene(scene), checked_step(step)
        *_, finished = self._drawn(scene, step, partial_interval=float("inf"))
        return finished

    def refine(
        self,
        scene: Scene,
        last: Step = Step.F,
        partial_interval: float = PARTIAL_INTERVAL,
        first: Step = Step.A,
    ) -> Iterator[Refinement]:
        """The steps `first` to `last`: each finished image, and partial images every `partial_interval` seconds.

        Ends early, without an error, when something else is drawn meanwhile.
        """
        scene, first, last = checked_scene(scene), checked_step(first, "first"), checked_step(last, "last")
        interval = checked_number(partial_interval, "partial_interval", least=0.0)
        return self._refined(scene, first, last, interval)

    def _refined(self, scene: Scene, first: Step, last: Step, partial_interval: float) -> Iterator[Refinement]:
        newest = 0  # frame of this refinement

        def drawn(step: Step) -> Iterator[Refinement]:
            nonlocal newest
            if newest not in (0, self._frame):
                raise Superseded
            newest = self._frame + 1
            return self._drawn(scene, step, partial_interval)

        try:
            yield from refined(drawn, scene, first, last)
        except Superseded:
            return

    def probe(self, scene: Scene, x: float, y: float) -> messages.ProbedVoxel | None:
        """The front-most voxel that is not transparent at a point of the image; see Session. Raises BadInput."""
        scene, x, y = checked_scene(scene), checked_number(x, "x"), checked_number(y, "y")
        geometry, scene = self.volume.description.geometry, self.volume.settled(scene)
        packing = self._packed(scene, Step.F)
        resolution = self._holding.finest()
        try:
            line = line_of_sight(scene, geometry, x, y, resolution)
        except ValueError as error:
            raise BadInput(str(error)) from error
        sub_cubes = self._held.sub_cubes(resolution.level)
        return front_most(sub_cubes, geometry, packing.quantisation, shading_rule(scene, Step.F), line)

    def _drawn(self, scene: Scene, step: Step, partial_interval: float) -> Iterator[Refinement]:
        """Partial images of the bare buffer, then the finished one."""
        began = shown = time.perf_counter()
        resolution, walk, assembly = self._stages(scene, step)
        tally = FrameTally(planning_seconds=time.perf_counter() - began)
        waiting_seconds = 0.0
        idle = Idle(assembly)
        for batch in self._batches(walk, tally):
            waiting_seconds += idle.seconds
            tally.count(batch)
            [part] = batch.parts
            assembly.arrived(WORKER, part.runs, part.packets, batch.reached, batch.last)
            assembly.advance()
            if time.perf_counter() - shown > partial_interval and not assembly.complete:
                yield Refinement(step, _published(assembly), None)
                if assembly.frame != self._frame:
                    raise Superseded
                shown = time.perf_counter()
            idle = Idle(assembly)
        while not assembly.complete:
            assembly.advance()
        drawn = time.perf_counter()
        image = _published(assembly)
        splat = messages.SplatStats(
            packets=assembly.packets,
            hidden_packets=assembly.hidden_packets,
            bytes=tally.bytes,
            frame_seconds=drawn - began,
            planning_seconds=tally.planning_seconds,
            merge_seconds=assembly.seconds_in_merge,
            splat_seconds=assembly.seconds_in_splat,
            waiting_seconds=waiting_seconds,
            answering_seconds=0.0,
            held_back_seconds={},
            work=[],
            peak_memory_bytes=peak_memory(),
            machine=this_machine(),
        )
        assert self._holding.packing is not None
        why = self._holding.packing.why_level
        outcome = FrameOutcome({WORKER: tally.stats()}, {WORKER: splat}, level=resolution.level, why_level=why)
        now = time.perf_counter()
        yield Refinement(step, image, StepOutcome(step, now - began, now - drawn, outcome))

    def _batches(self, walk: FrameWalk, tally: FrameTally) -> Iterator[ShadedBatch]:
        """The walk's batches; if a thread of its own walks, the next one is on its way while the last is splatted."""

        def next_batch() -> ShadedBatch | None:
            began = time.perf_counter()
            batch = walk.walkers[0].next_batch()
            tally.map_shade_seconds += time.perf_counter() - began
            return batch

        walker = self._walker
        self._ahead = walker.submit(next_batch) if walker is not None else None
        while (batch := next_batch() if self._ahead is None else self._ahead.result()) is not None:
            if walker is not None:
                self._ahead = walker.submit(next_batch)
            yield batch

    def _stages(self, scene: Scene, step: Step) -> tuple[Resolution, FrameWalk, FrameAssembly]:
        geometry, scene = self.volume.description.geometry, self.volume.settled(scene)
        if self._ahead is not None:
            self._ahead.result()  # an older frame's walk must not go on beside this one's
        self._frame += 1
        try:
            packing = self._packed(scene, step)
            resolution = self._holding.resolution(step, scene.refine.striding)
            plan = plan_frame(scene, geometry, step, resolution)
            assembly = FrameAssembly(plan, self._frame, [WORKER], image=self._image, threads=self._threads)
        except ValueError as error:
            raise BadInput(str(error)) from error
        self._image = assembly.image
        self._say(f"step {step}")
        sub_cubes = self._held.sub_cubes(resolution.level)
        shading, tiles = shading_rule(scene, step), assembly.image.closed_tiles
        walk = FrameWalk(sub_cubes, geometry, packing.quantisation, shading, plan, tiles)
        return resolution, walk, assembly

    def _packed(self, scene: Scene, step: Step) -> Packing:
        """Have the packets held that the step is drawn from."""
        packing = self._holding.wanted(scene, step)
        while not (self._holding.holds(packing) and self._holding.settled):
            self._carry_out(self._holding.prepare(packing))
        return packing

    def _carry_out(self, instructions: list[Instruction]) -> None:
        """Do here what a session has its servers do."""
        for instruction in instructions:
            match instruction:
                case ReportProgress(text):
                    self._say(text)
                case Send(message=message):
                    for answer in self._answers(message):
                        self._carry_out(self._taken(answer))

    def _taken(self, answer: Answer) -> list[Instruction]:
        holding, message, payload = self._holding, answer.message, memoryview(b"".join(answer.payload))
        if isinstance(message, messages.VolumeDescribed):
            return holding.described(message, payload)
        told: list[Instruction] = TAKEN[type(message)].method(
            holding, message, MessageReceived(WORKER, message, payload, at=0.0)
        )
        return told

    def _answers(self, message: messages.Message) -> list[Answer]:
        try:
            return self._held.answers(message)
        except BadInput:
            self._holding.refused(WORKER, type(message).__name__, self._held.assignment)
            raise

    def close(self) -> None:
        """End the threads."""
        if self._walker is not None:
            self._walker.shutdown()
        if self._image is not None:
            self._image.close()

    def __enter__(self) -> SingleProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _published(assembly: FrameAssembly) -> PublishedImage:
    return PublishedImage(assembly.published(), *assembly.plan.image_size)
