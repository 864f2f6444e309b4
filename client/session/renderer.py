"""What everything that draws a volume can do: the session with its servers and the single process alike."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

from volsplat.client.coordinator.coordinator_events import FrameOutcome
from volsplat.client.coordinator.server_states import VolumeIncomplete, part_of_volume
from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.messages import ImageRead, ProbedVoxel
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.rules.slice_plane import MOST_SAMPLES

if TYPE_CHECKING:
    from torch import Tensor

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


class Renderer(Finisher, Protocol):
    """A volume that is ready to be drawn."""

    def render(self, scene: Scene, step: Step = Step.F) -> Tensor:
        """The finished image of one step, (H, W, 4) float32, associated alpha."""

    def refine(
        self,
        scene: Scene,
        last: Step = Step.F,
        partial_interval: float = PARTIAL_INTERVAL,
        first: Step = Step.A,
        exact: Collection[Step] = ALL_STEPS,
    ) -> Iterator[Refinement]:
        """The steps `first` to `last`, each finished image and the partial images between; of G the first one sooner.

        Finished images of the `exact` steps keep each bit; what is only looked at may come with 8 bits a channel.
        """

    def probe(self, scene: Scene, x: float, y: float) -> ProbedVoxel | None:
        """The front-most visible voxel at a point of the scene's image, pixels from its first one's centre."""

    def file_voxel(self, index: Index, within: float = FILE_SECONDS) -> FileVoxel | None:
        """A voxel as the volume's file has it; None if that is not known `within` so many seconds."""

    def read_slice(self, scene: Scene, axis: str, index: int, longest: int = MOST_SAMPLES) -> VolumeSlice:
        """A slice of the volume across a grid axis, in the scene's colours."""

    def plane_counts(self, scene: Scene) -> PlaneCounts:
        """How many voxels have each density with each strength, in the scene's window."""


def refined(
    drawn: Callable[[Step], Iterator[Refinement]], scene: Scene, first: Step, last: Step
) -> Iterator[Refinement]:
    """The steps `first` to `last`, as `drawn` gives each: partial images of the bare buffer, then the finished one."""
    under: PublishedImage | None = None
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
