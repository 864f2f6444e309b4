"""Who should hold which part of the volume: by what the frames of the last second had to do where, and how fast.

Work is counted in packets. Where it lies is known by blocks as far as these tell, and by sub-cube as measured. Between
frames sub-cubes change hands if the last second would have been shorter by more than the move takes.
"""

from collections import defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain

from volsplat.client.coordinator.events.instructions import Instruction
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.shares.block_work import VOXELS_OF_A_PACKET, BlockWork
from volsplat.client.coordinator.shares.measured_speeds import MeasuredSpeeds
from volsplat.client.coordinator.shares.sub_cubes import Share, divided_by_work
from volsplat.protocol.description.patches import colourless
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.frame_messages import MapShadeStats, SplatStats

HORIZON = 1.0  # seconds: within them a move must pay for itself
LEAST_GAIN = 0.1  # of the busiest server's seconds: less may be chance
JUDGED_EVERY = 0.5  # seconds, at most
LEAST_FRAMES = 2  # one alone may be the last


@dataclass(frozen=True)
class _Frame:
    """What a frame took."""

    at: float  # when it was drawn, seconds
    work: dict[int, float]  # by map/shade server
    seconds: dict[int, float]  # likewise, of the busiest of its threads
    waited: float  # by the splat server that waited least, with nothing to splat


class WorkShares:
    """Forgets what it measured when other things become visible, or sub-cubes change hands."""

    def __init__(self, holding: VolumeHolding) -> None:
        self._holding = holding
        self._frames: deque[_Frame] = deque()  # of the last second
        self._judged_at = 0.0  # when shares were last looked at
        self._shows: object = None  # what decides which voxels are visible
        self._scene: Scene | None = None  # one that shows them
        self._work: BlockWork | None = None
        self._speeds = MeasuredSpeeds()  # packets a second

    def measured(
        self,
        scene: Scene,
        map_shade: Mapping[int, MapShadeStats],
        splat: Mapping[int, SplatStats],
        at: float,
    ) -> None:
        """Take what the servers of a finished frame report."""
        shows = _shown(scene)
        if shows != self._shows:
            self._shows, self._scene, self._work = shows, scene, None
            self._frames.clear()
        work = {n: stats.packets + stats.voxels_visited / VOXELS_OF_A_PACKET for n, stats in map_shade.items()}
        seconds = {n: stats.map_shade_seconds for n, stats in map_shade.items()}
        self._frames.append(_Frame(at, work, seconds, min(stats.waiting_seconds for stats in splat.values())))
        while self._frames[0].at < at - HORIZON:
            self._frames.popleft()

    def forget(self) -> None:
        """Other servers are there than before."""
        self._frames.clear()

    def move(self) -> list[Instruction]:
        """Have sub-cubes change hands, if that pays."""
        frames, due = self._frames, self._judged_at + JUDGED_EVERY
        if len(frames) < LEAST_FRAMES or frames[-1].at < due or not self._holding.may_move:
            return []
        self._judged_at = frames[-1].at
        boxes = self._better()
        if boxes is None:
            return []
        frames.clear()
        return self._holding.move(boxes)

    def _better(self) -> dict[int, Box] | None:
        """The boxes that each server should hold rather than what it holds; None where that would not pay."""
        holding = self._holding
        boxes, work = holding.boxes, self._summed("work")
        speeds = self._measured_speeds(work)
        busiest = max(work[n] / speeds[n] for n in boxes)
        saved = self._saved(busiest, sum(work.values()) / sum(speeds.values()))
        if saved <= LEAST_GAIN * busiest:
            return None  # however it were shared out
        blocks = self._corrected(boxes, work)
        packets, description = holding.packets_a_voxel, holding.description
        voxels = {n: sum(box.voxels for box in held) for n, held in boxes.items()}
        shares = [Share(speeds[n], holding.costs.most_voxels(n, voxels[n], packets)) for n in boxes]
        new = dict(zip(boxes, divided_by_work(description.geometry, shares, description.chunk, blocks), strict=True))
        then = zip(new, blocks.of([*new.values()]), strict=True)
        saved = self._saved(busiest, max(done / speeds[n] for n, done in then))
        fits = all(box.voxels <= share.most for box, share in zip(new.values(), shares, strict=True))
        pays = saved > max(LEAST_GAIN * busiest, holding.costs.seconds(holding.boxes, new, packets))
        return new if fits and pays else None

    def _saved(self, busiest: float, then: float) -> float:
        """Seconds of the last one, had the busiest server needed so many: as long as splat servers waited for it."""
        return min(busiest - then, sum(frame.waited for frame in self._frames))

    def _summed(self, what: str) -> dict[int, float]:
        """Over all frames, by server."""
        return {n: sum(getattr(frame, what)[n] for frame in self._frames) for n in self._holding.boxes}

    def _measured_speeds(self, work: Mapping[int, float]) -> dict[int, float]:
        for n, seconds in self._summed("seconds").items():
            self._speeds.note(n, work[n], seconds)
        return self._speeds.of(work)

    def _corrected(self, boxes: Mapping[int, list[Box]], measured: Mapping[int, float]) -> BlockWork:
        """The work by block, so that it is in each box what was measured there."""
        assert self._scene is not None and self._holding.volume is not None
        self._work = self._work or BlockWork.expected(self._holding.volume, self._scene)
        least = sum(measured.values()) / self._holding.description.geometry.box.voxels
        owners, each = [n for n, held in boxes.items() for _ in held], list(chain.from_iterable(boxes.values()))
        expected: defaultdict[int, float] = defaultdict(float)
        for n, done in zip(owners, self._work.of(each), strict=True):
            expected[n] += done
        self._work.multiply(each, [max(measured[n], least) / expected[n] for n in owners])
        return self._work


def _shown(scene: Scene) -> object:
    """What of a scene decides which voxels are visible."""
    if scene.plane.patches:
        return colourless(scene.plane.patches), scene.bounds, scene.quantise
    tables = scene.tables.opac, scene.tables.modu
    return *tables, scene.cross_bar.opac, scene.cross_bar.modu, scene.shading.modulation, scene.bounds, scene.quantise
