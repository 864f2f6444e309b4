"""Coded batches: what does not follow from the frame's plan, compressed (see docs/how_it_works/protocol.md)."""

from collections.abc import Sequence

import zstandard

from volsplat.mapshade_server._kernels import BatchEncoder
from volsplat.mapshade_server.links.shaded_batch import ShadedPart
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.sample_lattice import sample_lattice

QUICK, CLOSE = -10, 1  # levels of zstd: twice as fast as the other, and a quarter fewer bytes


class BatchCoder:
    """Codes the batches of one frame, one at a time."""

    def __init__(self, plan: FramePlan) -> None:
        """Raises ValueError where samples lie so close together that positions do not tell them apart."""
        self._encoder = BatchEncoder(sample_lattice(plan))
        self._compressors: dict[int, zstandard.ZstdCompressor] = {}

    def coded(self, parts: Sequence[ShadedPart], level: int) -> bytes:
        """Compressed at this level of zstd."""
        if level not in self._compressors:
            self._compressors[level] = zstandard.ZstdCompressor(level=level)
        code = self._encoder.encode([(part.runs, part.packets) for part in parts])
        return self._compressors[level].compress(code)


def coder_of(plan: FramePlan) -> BatchCoder | None:
    """None if positions do not tell the plan's samples apart."""
    if plan.slabs is not None:  # what its packets hold is no opacity and no colour
        return None
    try:
        return BatchCoder(plan)
    except ValueError:
        return None
