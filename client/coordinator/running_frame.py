"""A frame on its way, as the coordinator knows it."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace

from volsplat.client.coordinator.coordinator_events import FrameOutcome, PublishImage
from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.frame_messages import MapShadeStats, SplatStats


@dataclass
class RunningFrame:
    frame: int
    scene: Scene
    step: Step
    require_complete: bool  # only an image that shows the whole volume is wanted
    started: bool = False  # sent to the servers
    level: int = 0  # that is drawn
    why_level: str = ""
    partial_wanted: bool = False  # as soon as it has started
    unacknowledged: set[int] = field(default_factory=set)  # servers that were told to abort and have not said so
    image: PublishImage | None = None
    map_shade: dict[int, MapShadeStats] = field(default_factory=dict)
    splat: SplatStats | None = None
    drawn_at: float = 0.0

    def finished(self, workers: Collection[int], missing: tuple[Box, ...]) -> PublishImage | None:
        """The finished image, once it and the statistics of all its servers are here."""
        if self.image is None or self.splat is None or set(self.map_shade) != set(workers):
            return None
        outcome = FrameOutcome(self.map_shade, self.splat, missing, self.level, self.why_level)
        return replace(self.image, outcome=outcome, drawn_at=self.drawn_at)
