"""A frame on its way, as the coordinator knows it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from volsplat.client.coordinator.events.instructions import FrameOutcome, ImagePart, PublishImage
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.frame_messages import MapShadeStats, RenderFrame, SplatStats
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.levels import Thinning
from volsplat.protocol.rules.regions import Rectangle, lines_of, rectangle_of
from volsplat.protocol.text.errors import RemoteProtocolError


def progress_words(step: Step, share_done: float) -> str:
    """For who waits for a frame."""
    return f"step {step}: {100 * share_done:.0f} %"


@dataclass
class RunningFrame:
    """What was asked for, as FrameAsked has it, and what has come of it."""

    frame: int
    scene: Scene  # settled once it is known which volume it is of
    step: Step
    require_complete: bool
    exact: bool
    thinning: Thinning
    request: RenderFrame | None = None  # as it was sent to the servers
    rectangles: dict[int, Rectangle] = field(default_factory=dict)  # of the image, by splat server
    why_level: str = ""
    partial_wanted: bool = False  # as soon as it has started
    unacknowledged: set[int] = field(default_factory=set)  # servers that were told to abort and have not said so
    parts: dict[int, ImagePart] = field(default_factory=dict)  # that have come, by splat server: the newest of each
    awaited: set[int] = field(default_factory=set)  # splat servers whose parts the next partial image waits for
    whole: set[int] = field(default_factory=set)  # splat servers whose part is finished and here
    map_shade: dict[int, MapShadeStats] = field(default_factory=dict)
    splat: dict[int, SplatStats] = field(default_factory=dict)  # of those that have finished
    drawn_at: float = 0.0
    asked_how_far: set[int] = field(default_factory=set)  # splat servers that have not said yet how far they are
    shares_done: dict[int, float] = field(default_factory=dict)  # by splat server, as far as they have said

    @property
    def started(self) -> bool:
        """Sent to the servers."""
        return self.request is not None

    @property
    def drawn(self) -> bool:
        """All of the image is here, and will not change."""
        return bool(self.rectangles) and all(map(self.done, self.rectangles))

    def done(self, server: int) -> bool:
        """Whether nothing more is to come from a splat server."""
        return server in self.splat and server in self.whole

    @property
    def share_done(self) -> float:
        """What the splat server that is the furthest behind has done of its part, 0..1."""
        return min(1.0 if self.done(server) else self.shares_done.get(server, 0.0) for server in self.rectangles)

    def start(self, request: RenderFrame, why_level: str) -> None:
        plan, regions = request.drawing.plan, request.regions
        servers = dict.fromkeys(region.server for region in regions)
        self.request, self.why_level = request, why_level
        self.rectangles = {server: rectangle_of(plan, lines_of(regions, server)) for server in servers}

    def check_work(self, server: int, stats: SplatStats) -> None:
        """Raises RemoteProtocolError unless a splat server counts its work for the lines that it was given."""
        assert self.request is not None
        begin, end = lines_of(self.request.regions, server)
        rows = -(-end // TILE_SIDE) - begin // TILE_SIDE
        if len(stats.work) != rows:
            raise RemoteProtocolError(f"it counted its work in {len(stats.work)} rows of tiles, but has {rows}")

    def take(self, server: int, part: ImagePart, complete: bool) -> PublishImage | None:
        """The newest of a splat server. If it is the last that a partial image waited for: that image."""
        self.parts[server] = part
        if complete:
            self.whole.add(server)
        if server not in self.awaited:
            return None
        self.awaited.discard(server)
        return None if self.awaited or self.drawn else self._image(complete=False)

    def left_by(self, server: int) -> PublishImage | None:
        """The image as it stands, if any of it is here, without the part of a splat server that is lost."""
        self.parts.pop(server, None)
        return self._image(complete=False, missing=(self.rectangles[server],)) if self.parts else None

    def finished(
        self, boxes: Mapping[int, list[Box]], missing: tuple[Box, ...] = (), healing: bool = False
    ) -> PublishImage | None:
        """The finished image, once all of it and the statistics of all its servers are here."""
        if self.request is None or not self.drawn or self.map_shade.keys() != boxes.keys():
            return None
        voxels = {server: sum(box.voxels for box in held) for server, held in boxes.items()}
        level = self.request.drawing.level
        outcome = FrameOutcome(self.map_shade, self.splat, missing, healing, level, self.why_level, voxels)
        return self._image(complete=True, outcome=outcome)

    def _image(
        self, complete: bool, missing: tuple[Rectangle, ...] = (), outcome: FrameOutcome | None = None
    ) -> PublishImage:
        size = self.scene.image.width, self.scene.image.height
        parts = tuple(self.parts.values())
        return PublishImage(self.frame, self.step, *size, parts, complete, missing, outcome, self.drawn_at)
