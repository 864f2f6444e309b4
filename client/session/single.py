"""The single-processor version: the servers' very stages in one process, with no sockets.

The only file that imports both servers.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from volsplat.client.caller.arguments import (
    checked_bytes,
    checked_count,
    checked_index,
    checked_scene,
    checked_step,
    checked_volume,
)
from volsplat.client.caller.own_process import OwnProcess
from volsplat.client.coordinator.block_depths import BlockDepths, need_depths
from volsplat.client.coordinator.events.events import MessageReceived
from volsplat.client.coordinator.events.instructions import Found, FrameOutcome, Instruction, ReportProgress, Send
from volsplat.client.coordinator.holding.base_level import budgets
from volsplat.client.coordinator.holding.packing import Packing
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.running_frame import progress_words
from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.client.coordinator.voxel_question_kinds import Asked, question_for
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.memory.array_volume import volume_in_memory
from volsplat.client.session.asked_frames import FrameGivenUp
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.session.renderer import (
    FILE_SECONDS,
    PROGRESS_SECONDS,
    PartialPace,
    Refinement,
    Renderer,
    StepOutcome,
    refined,
)
from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.client.trace.single_frame import note_frame
from volsplat.client.volume.computable import computable
from volsplat.client.volume.file_voxel import FileVoxel, check_is_voxel
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.mapshade_server.answers.file_voxels import FileVoxels
from volsplat.mapshade_server.answers.visible_voxels import VoxelSheets
from volsplat.mapshade_server.answers.volume_answers import Answer
from volsplat.mapshade_server.answers.voxel_answers import VoxelAnswers
from volsplat.mapshade_server.answers.voxel_fields import VoxelFields
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import mixture_of
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.program.machine_limits import available_memory
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.description.volume_name import absolute_name
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import handlers
from volsplat.protocol.rules.levels import ALL_VOXELS, Thinning
from volsplat.protocol.text.errors import BadInput, PeerLost
from volsplat.splat_server._kernels import Bell, Owners
from volsplat.splat_server.frame_assembly import FrameAssembly
from volsplat.splat_server.slabs import slabs_of

WORKER = 1  # the one map/shade "server"
ASKED = 1  # the one question: it is answered before the next one is asked
LOOK_SECONDS = 0.1  # between two looks at whether something else is wanted
TAKEN = handlers(VolumeHolding)


@dataclass(frozen=True)
class _Begun:
    """A frame that the threads draw."""

    step: Step
    request: messages.RenderFrame
    assembly: FrameAssembly
    at: float  # perf_counter's seconds
    planned: float


class SingleProcess(Renderer):
    """A volume held and drawn by this process alone: the same images as a Session's, bit for bit.

    Any thread may call its methods. Of several that want a finished image each gets its own, one after another.
    """

    def __init__(
        self,
        volume: str | Path | Any,
        *,
        threads: int = 1,
        memory: int | str | None = None,
        trace: str | Path | None = None,
        on_progress: Callable[[str], None] | None = None,
    ) -> None:
        """Read and survey the volume. Raises BadInput.

        Each of the `threads` owns a region of the image, and walks what of the volume reaches it.
        `memory` is how many bytes of a prepared volume may be held; by default half of what the machine has left.
        `trace`: see Session.
        """
        self._in_memory = volume_in_memory(volume)
        name = absolute_name(checked_volume(volume if self._in_memory is None else self._in_memory.place))
        self.path = name if self._in_memory is None else None  # of the volume
        if trace is not None:
            check_written_apart(name, records=[Path(trace)])
        memory = None if memory is None else checked_bytes(memory, "memory")
        threads = checked_count(threads, "threads")
        self._say = on_progress or (lambda text: None)
        self._tracer = None if trace is None else FrameTracer(Path(trace))
        self._threads = threads
        self._opened_by = OwnProcess()
        self._owners = Owners(threads)
        self._news = Bell()
        self._shares = RegionShares()
        self._held = HeldVolume()
        self._file_voxels = FileVoxels()
        self._depths = BlockDepths()
        self._holding = VolumeHolding()
        self._drawing = threading.RLock()  # guards what is held, which frame is the newest, and what follows
        self._closed = False
        left = budgets({WORKER: available_memory()}, {WORKER: "here"})
        self._carry_out(self._holding.begin(name, left if memory is None else {WORKER: memory}))
        self._frame = 0  # the newest
        self._why_level = ""

    @property
    def volume(self) -> SurveyedVolume:
        """What is known of the volume."""
        assert self._holding.volume is not None
        return self._holding.volume

    @property
    def why_level(self) -> str:
        """Why this level of a prepared volume is held, once something was drawn of it; "" if there is only one."""
        return self._why_level

    def finish(self, scene: Scene, step: Step | str = Step.F) -> Refinement:
        """As `render`, with what it took."""
        scene, step = checked_scene(scene), checked_step(step)
        with self._drawing:
            *_, finished = self._drawn(self._begun(scene, step), partial_interval=float("inf"))
        return finished

    def _refined(
        self, scene: Scene, first: Step, last: Step, interval: float, exact: Collection[Step], thinning: Thinning
    ) -> Iterator[Refinement]:
        newest = 0  # frame of this refinement

        def drawn(step: Step) -> Iterator[Refinement]:
            nonlocal newest
            with self._drawing:
                if newest not in (0, self._frame):
                    raise FrameGivenUp("what followed a frame gave way to a newer one")
                begun = self._begun(scene, step, thinning)
                newest = self._frame
            return self._drawn(begun, interval)

        return refined(drawn, scene, first, last)

    def file_voxel(self, index: Index, within: float = FILE_SECONDS) -> FileVoxel | None:
        """A voxel as the volume's file has it, see Session; but what is read is waited for. Raises BadInput."""
        index, source = checked_index(index), self._holding.source
        check_is_voxel(index, self.volume.description.geometry.dims)
        if self._in_memory is not None:
            self._in_memory.check_open()
        if source is None:
            return None
        path, identity = source
        told, payload = self._file_voxels.read(
            messages.ReadVoxel(question=1, path=path, identity=identity, index=index)
        )
        assert isinstance(told, messages.VoxelRead)
        return FileVoxel.of_bytes(told.scalar_types, memoryview(b"".join(payload))) if told.scalar_types else None

    def _found(self, asked: Callable[[int], Asked]) -> Found:
        """What the voxels tell that are held for the scene. Raises BadInput."""
        question = question_for(asked(ASKED), self.volume)
        with self._drawing, computable():
            self._check_open()
            self._packed(question.asked.scene, Step.F)
            request = question.request(self._holding)
            sub_cubes = self._held.sub_cubes_asked(request)
        answer = VoxelAnswers(sub_cubes).answer(request)
        question.take(answer.message, answer.whole_payload)
        return question.found

    def voxels(self, scene: Scene, every: int = 1) -> VoxelSheets:
        """What step F of a scene is drawn from: every `every`th voxel on each axis. Raises BadInput."""
        scene, every = checked_scene(scene), checked_count(every, "every")
        scene = self.volume.settled(scene)
        with self._drawing, computable():
            self._check_open()
            self._packed(scene, Step.F)
            finest = self._holding.finest()
            drawing, sub_cubes = self._holding.drawing(scene, Step.F, finest), self._held.sub_cubes(finest.level)
        return VoxelSheets(sub_cubes, VoxelFields(drawing, mixture_of(sub_cubes)), finest.geometry, every)

    def _drawn(self, begun: _Begun, partial_interval: float) -> Iterator[Refinement]:
        """Partial images of the bare buffer, then the finished one. Raises FrameGivenUp."""
        step, assembly = begun.step, begun.assembly
        pace, shown = PartialPace(step, partial_interval), begun.at
        heard, progress_due = self._news.rung, begun.at + PROGRESS_SECONDS
        while not assembly.splat.complete:
            self._check_newest(assembly)
            until_partial = shown + pace.patience - time.perf_counter()
            heard = self._news.wait(heard, min(max(until_partial, 0.0), LOOK_SECONDS))
            if (now := time.perf_counter()) >= progress_due:
                self._say(progress_words(step, assembly.share_done))
                progress_due = now + PROGRESS_SECONDS
            if until_partial <= 0.0:
                if pace.shows(published := self._published(assembly)):
                    yield Refinement(step, published, None)
                shown = time.perf_counter()
        yield self._finished(begun, drawn=time.perf_counter())

    def _finished(self, begun: _Begun, drawn: float) -> Refinement:
        """The finished image, of a frame that was drawn at that moment. Raises FrameGivenUp."""
        step, assembly = begun.step, begun.assembly
        with self._drawing:
            image = self._published(assembly)
            servers = self._outcome(begun.request, assembly, begun.planned - begun.at, drawn - begun.at)
            now = time.perf_counter()
            if self._tracer is not None:
                moments = begun.at, begun.planned, drawn, now
                note_frame(self._tracer, begun.request.frame, step, moments, assembly.note_owners)
        return Refinement(step, image, StepOutcome(step, now - begun.at, now - drawn, servers))

    def _published(self, assembly: FrameAssembly) -> PublishedImage:
        """As it stands. Raises FrameGivenUp."""
        with self._drawing:
            self._check_newest(assembly)
            return PublishedImage(assembly.published(), *assembly.plan.image_size)

    def _check_newest(self, assembly: FrameAssembly) -> None:
        """Raises FrameGivenUp if another frame was begun, which ends this one, and PeerLost once all is closed."""
        self._check_open()
        if assembly.frame != self._frame:
            raise FrameGivenUp("this frame gave way to a newer one")

    def _begun(self, scene: Scene, step: Step, thinning: Thinning = ALL_VOXELS) -> _Begun:
        """Have the threads draw it, and nothing else any more; the lock is held. Raises BadInput."""
        began = time.perf_counter()
        self._opened_by.check()
        self._check_open()
        self.volume.check_step(step)
        scene = self.volume.settled(scene)
        self._frame += 1
        with computable():
            self._why_level = self._packed(scene, step).why_level
            request = self._request(scene, step, thinning)
            assembly = FrameAssembly(self._owners, request.drawing.plan, request.frame, slabs_of(request))
        self._say(f"step {step}")
        sub_cubes = self._held.sub_cubes_asked(request)
        with self._held.room_to_walk(request.drawing, sub_cubes):
            walk = FrameWalk(sub_cubes, request.drawing, assembly.closed_tiles, request.regions, walkers=None)
        assembly.begin(request.regions, 0, self._news, walks=walk.walkers, traced=self._tracer is not None)
        return _Begun(step, request, assembly, at=began, planned=time.perf_counter())

    def _request(self, scene: Scene, step: Step, thinning: Thinning) -> messages.RenderFrame:
        """Of what is held, with what dims its light."""
        threads = {WORKER: self._threads}
        resolution = self._holding.resolution(step, scene.refine.striding, thinning)
        drawing = self._holding.drawing(scene, step, resolution)
        regions = self._shares.regions(drawing.plan, threads)
        request = messages.RenderFrame(self._frame, self._held.assignment, drawing, threads, regions, exact=True)
        return self._dimmed(request, scene) if need_depths(scene, step) else request

    def _dimmed(self, request: messages.RenderFrame, scene: Scene) -> messages.RenderFrame:
        for server, asked in self._depths.ask(request, [WORKER]):
            answer = VoxelAnswers(self._held.sub_cubes_asked(asked)).answer(asked)
            assert isinstance(answer.message, messages.DepthsSummed)
            self._depths.take(server, answer.message, answer.whole_payload)
        return self._depths.dimmed(request, scene.light)

    def _outcome(
        self, request: messages.RenderFrame, assembly: FrameAssembly, planning: float, frame: float
    ) -> FrameOutcome:
        """What it took; of the threads the one is told that had most to do."""
        owned, walked = assembly.slowest_owner, assembly.splat.walked
        splat = assembly.stats(walked.bytes, planning, frame)
        walk = messages.MapShadeStats(
            voxels_visited=walked.voxels,
            packets=walked.packets,
            batches=walked.steps,
            raw_bytes=walked.bytes,
            bytes=walked.bytes,
            planning_seconds=planning,
            map_shade_seconds=owned.walk,
            coding_seconds=0.0,
            sending_seconds=0.0,
            waiting_seconds=0.0,
            peak_memory_bytes=splat.peak_memory_bytes,
            machine=splat.machine,
        )
        self._shares.measured(request, {WORKER: splat})
        return FrameOutcome({WORKER: walk}, {WORKER: splat}, level=request.drawing.level, why_level=self.why_level)

    def _packed(self, scene: Scene, step: Step) -> Packing:
        """Have the packets held that the step is drawn from."""
        with self._drawing:
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
        holding, message, payload = self._holding, answer.message, answer.whole_payload
        if isinstance(message, messages.VolumeDescribed):
            return holding.described(message, payload)
        told: list[Instruction] = TAKEN[type(message)].method(
            holding, message, MessageReceived(WORKER, message, payload, at=0.0)
        )
        return told

    def _answers(self, message: messages.Message) -> list[Answer]:
        try:
            return self._held.answers(message)
        except BadInput as error:
            self._holding.refused(WORKER, type(message).__name__, self._held.assignment, error)
            raise

    def _check_open(self) -> None:
        if self._closed:
            raise PeerLost("the session is closed")

    def close(self) -> None:
        """End the threads, unless this process was forked and has none, and let go of what is held of the volume."""
        if not self._opened_by.is_here:
            return
        self._closed = True  # before the lock is waited for: who draws leaves it then
        with self._drawing:
            self._owners.close()
            self._held.let_go()
        if self._tracer is not None:
            self._tracer.close()
