"""Coded batches: what does not follow from the frame's plan, compressed (see docs/protocol.md)."""

from collections.abc import Sequence

import lz4.block

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frame_walk import ShadedPart
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.sample_lattice import sample_lattice

ACCELERATION = 4  # of LZ4: a twentieth more bytes than at 1, in two thirds of the time


class BatchCoder:
    """Codes the batches of one frame, one at a time."""

    def __init__(self, plan: FramePlan, acceleration: int = ACCELERATION) -> None:
        """Raises ValueError where samples lie so close together that positions do not tell them apart."""
        self._encoder = _kernels.BatchEncoder(sample_lattice(plan))
        self._acceleration = acceleration

    def coded(self, parts: Sequence[ShadedPart]) -> bytes:
        code = self._encoder.encode([(part.runs, part.packets) for part in parts])
        packed: bytes = lz4.block.compress(code, mode="fast", acceleration=self._acceleration, store_size=False)
        return packed
