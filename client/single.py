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

from volsplat.client.coordinator_events import FrameOutcome
from volsplat.client.renderer import PARTIAL_INTERVAL, Refinement, StepOutcome, image_tensor, refined
from volsplat.client.surveyed_volume import SurveyedVolume
from volsplat.mapshade_server.frame_tally import FrameTally
from volsplat.mapshade_server.frame_walk import FrameWalk, ShadedBatch
from volsplat.mapshade_server.probe import front_most
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol import messages
from volsplat.protocol.errors import BadInput
from volsplat.protocol.index_rules import Quantisation
from volsplat.protocol.line_of_sight import LineOfSight
from volsplat.protocol.peak_memory import peak_memory
from volsplat.protocol.scene import Scene, Step
from volsplat.splat_server.frame_assembly import FrameAssembly
from volsplat.splat_server.image_buffer import ImageBuffer

if TYPE_CHECKING:
    from torch import Tensor

WORKER = 1  # the one map/shade "server"


class Superseded(Exception):
    """Another frame was drawn since; nothing is left of this one."""


class SingleProcess:
    """A volume held and drawn by this process alone: the same images as a Session's, bit for bit."""

    def __init__(
        self, volume: str | Path, *, threads: int = 1, on_progress: Callable[[str], None] | None = None
    ) -> None:
        """Read and survey the volume. Raises BadInput.

        `threads` splat, one image stripe each; where there are several, one more walks ahead of them.
        """
        self._say = on_progress or (lambda text: None)
        self._threads = threads
        self._walker = ThreadPoolExecutor(1, "walk") if threads > 1 else None
        self._reader = open_volume(str(volume))
        description = self._reader.describe()
        self._sub_cube = SubCube(description.geometry, description.geometry.box, description.second_scalar)
        self._read()
        survey = self._sub_cube.survey()
        self._say("counting the histograms")
        density, strength = self._sub_cube.histograms(survey.low, survey.high, survey.max_gradient)
        self._volume = SurveyedVolume(description, survey, density.tolist(), strength.tolist())
        self._quantisation: Quantisation | None = None
        self._image: ImageBuffer | None = None
        self._frame = 0
        self._ahead: Future[ShadedBatch | None] | None = None  # the batch that the walker is at

    @property
    def volume(self) -> SurveyedVolume:
        """What is known of the volume."""
        return self._volume

    def render(self, scene: Scene, step: Step = Step.F) -> Tensor:
        """The finished image of one step, (H, W, 4) float32, associated alpha. Raises BadInput."""
        return self.finish(scene, step).image

    def finish(self, scene: Scene, step: Step = Step.F) -> Refinement:
        """As `render`, with what it took."""
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
        geometry = self._volume.description.geometry
        try:
            line = LineOfSight(scene, geometry, x, y)
        except ValueError as error:
            raise BadInput(str(error)) from error
        quantisation = self._packed(self._volume.quantisation(scene.quantise))
        return front_most([self._sub_cube], geometry, quantisation, scene, line)

    def _drawn(self, scene: Scene, step: Step, partial_interval: float) -> Iterator[Refinement]:
        """Partial images of the bare buffer, then the finished one."""
        began = shown = time.perf_counter()
        walk, assembly = self._stages(scene, step)
        tally = FrameTally(planning_seconds=time.perf_counter() - began)
        waiting_seconds = 0.0
        asked = time.perf_counter()
        for batch in self._batches(walk, tally):
            waiting_seconds += time.perf_counter() - asked
            tally.count(batch)
            assembly.arrived(WORKER, batch.runs, batch.packets, batch.reached, batch.last)
            assembly.advance()
            if time.perf_counter() - shown > partial_interval and not assembly.complete:
                yield Refinement(step, _tensor(assembly), None)
                if assembly.frame != self._frame:
                    raise Superseded
                shown = time.perf_counter()
            asked = time.perf_counter()
        while not assembly.complete:
            assembly.advance()
        drawn = time.perf_counter()
        image = _tensor(assembly)
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
            peak_memory_bytes=peak_memory(),
        )
        outcome = FrameOutcome({WORKER: tally.stats()}, splat)
        now = time.perf_counter()
        yield Refinement(step, image, StepOutcome(step, now - began, now - drawn, outcome))

    def _batches(self, walk: FrameWalk, tally: FrameTally) -> Iterator[ShadedBatch]:
        """The walk's batches; with several threads the next one is on its way while the last is splatted."""

        def next_batch() -> ShadedBatch | None:
            began = time.perf_counter()
            batch = walk.next_batch()
            tally.map_shade_seconds += time.perf_counter() - began
            return batch

        walker = self._walker
        self._ahead = walker.submit(next_batch) if walker is not None else None
        while (batch := next_batch() if self._ahead is None else self._ahead.result()) is not None:
            if walker is not None:
                self._ahead = walker.submit(next_batch)
            yield batch

    def _stages(self, scene: Scene, step: Step) -> tuple[FrameWalk, FrameAssembly]:
        geometry = self._volume.description.geometry
        if self._ahead is not None:
            self._ahead.result()  # an older frame's walk must not go on beside this one's
        self._frame += 1
        try:
            assembly = FrameAssembly(
                scene, geometry, step, self._frame, [WORKER], image=self._image, threads=self._threads
            )
        except ValueError as error:
            raise BadInput(str(error)) from error
        self._image = assembly.image
        quantisation = self._packed(self._volume.quantisation(scene.quantise))
        self._say(f"step {step}")
        walk = FrameWalk([self._sub_cube], geometry, quantisation, scene, assembly.plan, assembly.image.closed_tiles)
        return walk, assembly

    def _packed(self, quantisation: Quantisation) -> Quantisation:
        """Have the voxels packed by these rules."""
        if quantisation != self._quantisation:
            if self._quantisation is not None:
                self._read()
            self._say("making voxel packets")
            self._sub_cube.pack(quantisation)
            self._quantisation = quantisation
        return quantisation

    def _read(self) -> None:
        self._say("reading the volume")
        self._sub_cube.read(self._reader)

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


def _tensor(assembly: FrameAssembly) -> Tensor:
    return image_tensor(assembly.published(), assembly.plan.width, assembly.plan.height)
