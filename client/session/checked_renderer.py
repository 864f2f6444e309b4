"""What scripts ask of everything that draws a volume, with all that they hand in checked: a session and one process."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self

from volsplat.client.caller.arguments import checked_axis, checked_count, checked_number, checked_place, checked_scene
from volsplat.client.coordinator.coordinator_events import Found, PlaneAsked, PointAsked, SliceAsked
from volsplat.client.coordinator.voxel_question_kinds import Asked
from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.session.renderer import Refinement
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.messages.frame_messages import ProbedVoxel
from volsplat.protocol.rules.slice_plane import MOST_SAMPLES

if TYPE_CHECKING:
    from torch import Tensor


class CheckedRenderer(ABC):
    """A volume that is drawn, and asked about. Closed at the end of a `with` block."""

    @abstractmethod
    def finish(self, scene: Scene, step: Step | str = Step.F) -> Refinement:
        """As `render`, with what it took."""

    @abstractmethod
    def close(self) -> None:
        """Let go of all that draws it."""

    @abstractmethod
    def _found(self, asked: Callable[[int], Asked]) -> Found:
        """The answer to a question, which is made of its number. Raises BadInput if it does not fit the volume."""

    def render(self, scene: Scene, step: Step | str = Step.F) -> Tensor:
        """The finished image of one step, (H, W, 4) float32, associated alpha, without the background.

        Raises BadInput if the scene does not fit the volume or torch is not installed, PeerLost if a server is gone
        and with it a part of the volume, and FrameGivenUp if a newer frame took its place.
        """
        return self.finish(scene, step).image

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
