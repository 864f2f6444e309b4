"""How opaque the blocks are that light passes: asked of the servers that hold the volume, before a frame that needs it.

What was answered last is kept, and holds while tables, bounds and what is held stay the same, however the volume turns.
"""

from collections.abc import Iterable
from typing import Any

import msgspec

from volsplat.protocol.description.patches import colourless
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Light, Scene
from volsplat.protocol.description.shading_tables import SCREEN_FIELDS
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.frame_messages import DepthsSummed, RenderFrame, SumDepths
from volsplat.protocol.rules.light_blocks import (
    DEPTH_BYTES,
    DEPTH_UNIT,
    SUM_UNIT,
    LightBlocks,
    box_drawn,
    light_block_dims,
    light_block_size,
)
from volsplat.protocol.rules.refinement import STEP_RULES
from volsplat.protocol.text.errors import RemoteProtocolError

LARGEST_DEPTH = (1 << 8 * DEPTH_BYTES) - 1


def need_depths(scene: Scene, step: Step) -> bool:
    """Whether light is dimmed on its way in this step."""
    return STEP_RULES[step].slabs and (scene.light.shadows > 0.0 or scene.light.occlusion > 0.0)


class BlockDepths:
    """Of one scene at a time."""

    def __init__(self) -> None:
        self._key: object = None  # of what is known, or asked for
        self._asked: SumDepths | None = None
        self._pending: set[int] = set()
        self._sums: Any = None  # an array, so that a session need not wait for numpy before it starts its servers
        self._depths = b""  # the means, once all have answered

    @property
    def under_way(self) -> bool:
        """Whether somebody has been asked, and not answered."""
        return bool(self._pending)

    def ask(self, frame: RenderFrame, servers: Iterable[int]) -> list[tuple[int, SumDepths]]:
        """Who is to be asked for them now, and what: nobody if they are known, or the frame has asked already."""
        holders = frozenset(servers)
        key = (_key(frame), holders)
        if key == self._key and (not self._pending or (self._asked and self._asked.frame == frame.frame)):
            return []
        self._key, self._pending, self._sums = key, set(holders), None
        self._asked = SumDepths(frame.frame, frame.assignment, frame.drawing)
        return [(server, self._asked) for server in sorted(holders)]

    def take(self, server: int, message: DepthsSummed, payload: bytes | memoryview) -> None:
        """Raises RemoteProtocolError for what are no blocks of the volume's."""
        import numpy as np

        asked = self._asked
        if asked is None or (message.frame, message.assignment) != (asked.frame, asked.assignment):
            return
        if server not in self._pending:
            return
        dims = light_block_dims(asked.drawing.dims)
        if message.blocks != dims:
            raise RemoteProtocolError(f"it summed the depths of {message.blocks} blocks, not of {dims}")
        sums = np.frombuffer(payload, "<u8")
        self._sums = sums if self._sums is None else self._sums + sums
        self._pending.discard(server)
        if not self._pending:
            self._depths = _means(self._sums, asked.drawing.dims)

    def dimmed(self, frame: RenderFrame, light: Light) -> RenderFrame:
        """The request with what dims its light, once that is known."""
        assert self._asked is not None and not self._pending
        dims = self._asked.drawing.dims
        size, blocks = light_block_size(dims), light_block_dims(dims)
        passed = LightBlocks(size, blocks, self._depths, light.shadows, light.occlusion)
        return msgspec.structs.replace(frame, light=passed)


def _means(sums: Any, dims: Index) -> bytes:
    """The depths of LightBlocks by their sums, uint64 each."""
    import numpy as np

    size, blocks = light_block_size(dims), light_block_dims(dims)
    i, j, k = (
        np.minimum(np.arange(count) * of + of, voxels) - np.arange(count) * of
        for count, of, voxels in zip(blocks, size, dims, strict=True)
    )
    voxels = (k[:, None, None] * j[:, None] * i).reshape(-1).astype(np.uint64)
    unit = np.uint64(SUM_UNIT // DEPTH_UNIT) * voxels
    depths = np.minimum((sums + unit // np.uint64(2)) // unit, np.uint64(LARGEST_DEPTH))
    told: bytes = depths.astype("<u2").tobytes()
    return told


def _key(frame: RenderFrame) -> object:
    """All that depths depend on."""
    drawing, shading = frame.drawing, frame.drawing.shading
    fields = (shading.cross_bar.opac, shading.cross_bar.modu)
    on_screen = drawing.plan.screen_index if any(field in SCREEN_FIELDS for field in fields) else None
    opacity = (shading.opac, shading.modu, fields, colourless(shading.patches))
    return (frame.assignment, drawing.level, drawing.quantisation, opacity, box_drawn(drawing.plan), on_screen)
