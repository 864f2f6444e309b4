"""Which level of a prepared volume the finest step draws: fine enough for the zoom, and within the servers' memory.

A precise scene wants the volume itself, however small its voxels are: levels are not quite as bright.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.messages.messages import LevelBoxes
from volsplat.protocol.rules import levels
from volsplat.protocol.rules.packet_layout import VOXEL_PACKET_BYTES
from volsplat.protocol.rules.resolved_view import resolved_zoom
from volsplat.protocol.text.byte_sizes import bytes_text

# Held: its packet, and lists of what can be seen.
BYTES_PER_VOXEL = VOXEL_PACKET_BYTES * (1 + levels.LISTS_PER_STORED_PACKET)
SHARE_OF_MEMORY = 0.5  # of what a machine has left, for all its servers together
STEADY = 0.8  # while a person zooms out, the next coarser level must be so far within a pixel before it is taken


@dataclass(frozen=True)
class BaseLevel:
    """The level that steps C to F draw."""

    level: int
    why: str  # for a person, in one line


@dataclass(frozen=True)
class LevelChoice:
    """What the choice depends on, besides the scene."""

    grids: Sequence[Geometry]  # of all levels, finest first
    boxes: Mapping[int, list[Box]]  # of the volume, by server
    memory: Mapping[int, int]  # bytes, by server

    def base_level(self, scene: Scene, current: int | None = None) -> BaseLevel:
        """The level for a scene; `current` is kept where it is only just finer than needed."""
        needed, reason = 0, "the scene is precise"
        if not scene.reconstruction.precise:
            needed, reason = self._for_zoom(scene, current), "the finest that the zoom needs"
        fits = next((n for n in range(needed, len(self.grids)) if self._fits(n)), len(self.grids) - 1)
        if fits > needed:
            reason = f"the finest that fits into {bytes_text(min(self.memory.values()))} of each server"
        i, j, k = levels.factors_of(self.grids[0], self.grids[fits])
        what = "the volume itself" if fits == 0 else f"every voxel is the mean of {i} x {j} x {k}"
        return BaseLevel(fits, f"level {fits} of {len(self.grids) - 1}: {what}; {reason}")

    def _for_zoom(self, scene: Scene, current: int | None) -> int:
        zoom = resolved_zoom(scene, self.grids[0])
        needed = levels.finest_needed(self.grids, zoom)
        if current is not None and current < needed:
            needed = max(current, levels.finest_needed(self.grids, zoom / STEADY))
        return needed

    def holdings(self, server: int, held_levels: Iterable[int]) -> list[LevelBoxes]:
        """A server's part of each of these levels."""
        held = []
        for level in held_levels:
            factors = levels.factors_of(self.grids[0], self.grids[level])
            shares = [levels.share_at_level(box, factors) for box in self.boxes[server]]
            held.append(LevelBoxes(level=level, boxes=[share for share in shares if min(share.size) > 0]))
        return held

    def _fits(self, base: int) -> bool:
        drawn = levels.levels_drawn(self.grids, base)
        return all(
            BYTES_PER_VOXEL * sum(box.voxels for one in self.holdings(server, drawn) for box in one.boxes) <= memory
            for server, memory in self.memory.items()
            if server in self.boxes
        )


def budgets(memory: Mapping[int, int], hosts: Mapping[int, str]) -> dict[int, int]:
    """What each server may hold, by what its machine has left: those of one host share it."""
    on_host = Counter(hosts[server] for server in memory)
    return {server: int(SHARE_OF_MEMORY * left / on_host[hosts[server]]) for server, left in memory.items()}
