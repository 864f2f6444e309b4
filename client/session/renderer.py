"""What everything that draws a volume can do: the session with its servers and the single process alike."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

from volsplat.client.caller.arguments import (
    checked_axis,
    checked_count,
    checked_number,
    checked_place,
    checked_scene,
    checked_step,
    checked_steps,
    checked_thinning,
)
from volsplat.client.coordinator.events.events import PlaneAsked, PointAsked, SliceAsked
from volsplat.client.coordinator.events.instructions import Found, FrameOutcome
from volsplat.client.coordinator.server_states import VolumeIncomplete, part_of_volume
from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.session.asked_frames import FrameGivenUp
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.messages import ImageRead, ProbedVoxel
from volsplat.protocol.rules.levels import ALL_VOXELS, Thinning
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.rules.slice_plane import MOST_SAMPLES

if TYPE_CHECKING:
    from torch import Tensor

    from volsplat.client.coordinator.voxel_question_kinds import Asked

PARTIAL_INTERVAL = 0.1  # seconds between partial images
PROGRESS_SECONDS = 1.0  # between two words of how far a frame is
SOONER = 0.2  # of that interval, after which slabs are looked at until the first of them show anything
FILE_SECONDS = 2.0  # that a voxel of the file is waited for
ALL_STEPS = tuple(Step)


@dataclass(frozen=True)
class StepOutcome:
    """How a finished step went: what the servers counted and the seconds that it took here."""

    step: Step
    wall_seconds: float  # from asking to having the image
    image_seconds: float  # of these, from the finished frame on: its image is sent
    servers: FrameOutcome
    image_reads: Mapping[int, ImageRead] = field(default_factory=dict)  # how each splat server's part of it came

    @property
    def image_bytes(self) -> int:
        """Of the finished image, as splat servers sent it; none lie in memory that is shared."""
        return sum(image.payload_bytes() for image in self.image_reads.values())

    @property
    def image_coding_seconds(self) -> float:
        """That the slowest splat server took to code it."""
        return max((image.coding_seconds for image in self.image_reads.values()), default=0.0)


@dataclass(frozen=True)
class Refinement:
    """One image on the way."""

    step: Step
    published: PublishedImage
    outcome: StepOutcome | None  # None while the step is still being drawn
    undrawn: tuple[Rectangle, ...] = ()  # of an unfinished image, lost with a splat server; others draw it anew

    @property
    def image(self) -> Tensor:
        """(H, W, 4) float32, associated alpha, 0..1, without the background. Raises BadInput without torch."""
        return self.published.tensor

    @property
    def complete(self) -> bool:
        return self.outcome is not None


class PartialPace:
    """When a step that is being drawn is looked at, and whether what is seen is worth showing.

    Step G shows slab by slab, from the front: its first slabs should be seen soon, and nothing is no news.
    """

    def __init__(self, step: Step, interval: float) -> None:
        """Seconds between two looks; infinity: never."""
        self._interval = interval
        self._waits_for_slabs = step not in PAPER_STEPS

    @property
    def patience(self) -> float:
        """Seconds until the next look."""
        return self._interval * (SOONER if self._waits_for_slabs else 1.0)

    def shows(self, published: PublishedImage, undrawn: tuple[Rectangle, ...] = ()) -> bool:
        """Whether this, which was seen now, is to be shown."""
        if self._waits_for_slabs and (undrawn or published.pixels[..., 3].any()):
            self._waits_for_slabs = False
        return not self._waits_for_slabs


class Finisher(Protocol):
    """What draws finished images of a volume."""

    @property
    def volume(self) -> SurveyedVolume:
        """What is known of the volume; waits until it is known."""

    def finish(self, scene: Scene, step: Step = Step.F) -> Refinement:
        """The finished image of one step, with what it took."""


class Renderer(ABC):
    """A volume that is ready to be drawn, and asked about, until it is closed. What scripts hand in is checked here."""

    @property
    @abstractmethod
    def volume(self) -> SurveyedVolume:
        """What is known of the volume; waits until it is known."""

    @abstractmethod
    def finish(self, scene: Scene, step: Step | str = Step.F) -> Refinement:
        """As `render`, with what it took."""

    @abstractmethod
    def file_voxel(self, index: Index, within: float = FILE_SECONDS) -> FileVoxel | None:
        """A voxel as the volume's file has it; None if that is not known `within` so many seconds."""

    @abstractmethod
    def close(self) -> None:
        """Let go of all that draws it."""

    @abstractmethod
    def _refined(
        self, scene: Scene, first: Step, last: Step, interval: float, exact: Collection[Step], thinning: Thinning
    ) -> Iterator[Refinement]:
        """As `refine`."""

    @abstractmethod
    def _found(self, asked: Callable[[int], Asked]) -> Found:
        """The answer to a question, which is made of its number. Raises BadInput if it does not fit the volume."""

    def render(self, scene: Scene, step: Step | str = Step.F) -> Tensor:
        """The finished image of one step, (H, W, 4) float32, associated alpha, without the background.

        Raises BadInput if the scene does not fit the volume or torch is not installed, PeerLost if a server is gone
        and with it a part of the volume, and FrameGivenUp if a newer frame took its place.
        """
        return self.finish(scene, step).image

    def refine(
        self,
        scene: Scene,
        last: Step | str = Step.F,
        partial_interval: float = PARTIAL_INTERVAL,
        first: Step | str = Step.A,
        exact: Collection[Step | str] = ALL_STEPS,
        thinning: Thinning = ALL_VOXELS,
    ) -> Iterator[Refinement]:
        """The steps `first` to `last`: each finished image, and partial images every `partial_interval` seconds.

        The first partial image of step G comes as soon as its first slabs show anything. Finished images of the `exact`
        steps keep each bit. By a slow link all others, and partial images, come with 8 bits a channel, which look the
        same. `thinning` says which of a step's voxels are left out: coarser by 1 or 2 octaves it draws every 2nd or 4th
        on each axis, or a prepared volume's means.

        A partial image lies over the finished one of the step before unless the scene asks for the bare buffer.
        Ends early, without an error, when something else is asked for or all is aborted.

        Goes on if servers are lost while there are others. What such a step still shows comes as a finished image whose
        outcome says what is missing from it; then, once others have taken over, the step is drawn anew.
        Raises PeerLost if nothing can be drawn any more.
        """
        scene, first, last = checked_scene(scene), checked_step(first, "first"), checked_step(last, "last")
        interval = min(checked_number(partial_interval, "partial_interval", least=0.0), threading.TIMEOUT_MAX)
        steps, thinning = checked_steps(exact, "exact"), checked_thinning(thinning)
        return self._refined(scene, first, last, interval, steps, thinning)

    def probe(self, scene: Scene, x: float, y: float) -> ProbedVoxel | None:
        """The front-most voxel that is not transparent at a point of the scene's image, None if there is none.

        x and y are pixels from the centre of the image's top left pixel, x to the right and y down. The image need not
        be drawn, and a frame that runs goes on.
        Raises BadInput if the scene does not fit the volume, and PeerLost if nothing can be drawn any more.
        """
        scene, x, y = checked_scene(scene), checked_number(x, "x"), checked_number(y, "y")
        found = self._found(lambda number: PointAsked(number, scene, x, y))
        assert found is None or isinstance(found, ProbedVoxel), "nothing else was asked for"
        return found

    def read_slice(self, scene: Scene, axis: str, index: int, longest: int = MOST_SAMPLES) -> VolumeSlice:
        """What is held of a slice across "i", "j" or "k", with the colours that the scene gives its voxels.

        At most `longest` samples lie along a side. No image need be drawn, and a frame that runs goes on. What no
        server holds any more is missing from it.
        Raises BadInput if the volume has no such slice, and PeerLost if nothing can be drawn any more.
        """
        return self._slice(checked_scene(scene), axis, index, longest)

    def _slice(self, scene: Scene, axis: str, index: int, longest: int, as_packed: bool = False) -> VolumeSlice:
        across, index, longest = checked_axis(axis), checked_place(index, "index"), checked_count(longest, "longest")
        found = self._found(lambda number: SliceAsked(number, scene, across, index, longest, as_packed))
        assert isinstance(found, VolumeSlice), "a slice was asked for"
        return found

    def plane_counts(self, scene: Scene) -> PlaneCounts:
        """How many voxels have each density with each strength, in the scene's window: the 2-D histogram.

        They are those that are held, which of a prepared volume are those of a level. Frames that run go on.
        Raises BadInput for a window without a scale, and PeerLost if nothing can be drawn any more.
        """
        scene = checked_scene(scene)
        found = self._found(lambda number: PlaneAsked(number, scene))
        assert isinstance(found, PlaneCounts), "counts were asked for"
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def refined(
    drawn: Callable[[Step], Iterator[Refinement]], scene: Scene, first: Step, last: Step
) -> Iterator[Refinement]:
    """The steps `first` to `last`, as `drawn` gives each: partial images of the bare buffer, then the finished one.

    Ends where `drawn` raises FrameGivenUp.
    """
    under: PublishedImage | None = None
    with suppress(FrameGivenUp):
        for step in [step for step in Step if first <= step <= last]:
            for refinement in drawn(step):
                if refinement.complete:
                    under = None if scene.refine.bare_buffer else refinement.published
                    yield refinement
                else:
                    yield replace(refinement, published=laid_over(refinement.published, under))


def finished_whole(refinements: Iterable[Refinement]) -> Iterator[Refinement]:
    """Those that show the whole volume, for files. Raises PeerLost if a part of it is gone for good."""
    for refinement in refinements:
        if refinement.outcome is None or refinement.outcome.servers.healing:
            continue
        if missing := refinement.outcome.servers.missing:
            raise VolumeIncomplete(f"a map/shade server was lost: {part_of_volume(missing)} of the volume are missing")
        yield refinement


def laid_over(partial: PublishedImage, finished: PublishedImage | None) -> PublishedImage:
    """A step's partial image over the finished image of the step before (design, section 6)."""
    if finished is None:
        return partial
    return PublishedImage.of(partial.pixels + (1.0 - partial.pixels[..., 3:]) * finished.pixels)
