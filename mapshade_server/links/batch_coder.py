"""Coded batches: what does not follow from the frame's plan, compressed (see docs/how_it_works/protocol.md)."""

from collections.abc import Sequence

import zstandard

from volsplat.mapshade_server._kernels import BatchEncoder
from volsplat.mapshade_server.links.shaded_part import ShadedPart
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES
from volsplat.protocol.rules.sample_lattice import VOXEL_CODE, sample_lattice

QUICK, CLOSE = -10, 1  # levels of zstd: twice as fast as the other, and a quarter fewer bytes


class BatchCoder:
    """Codes the batches of one frame, one at a time."""

    def __init__(self, plan: FramePlan) -> None:
        """Raises ValueError where samples lie so close together that positions do not tell them apart."""
        self._encoder = BatchEncoder(sample_lattice(plan))
        self._compressors = _Compressors()

    def coded(self, parts: Sequence[ShadedPart], level: int) -> bytes:
        """Compressed at this level of zstd."""
        code = self._encoder.encode([(part.runs, part.packets) for part in parts])
        return self._compressors.at(level).compress(code)


class VoxelBatchCoder:
    """Codes the batches of a frame of slabs: byte by byte of all runs and of all packets, without looking into them.

    Neighbours differ in their low bytes alone, so that the others become nearly nothing.
    """

    def __init__(self) -> None:
        self._compressors = _Compressors()

    def coded(self, parts: Sequence[ShadedPart], level: int) -> bytes:
        """Compressed at this level of zstd."""
        planes = [VOXEL_CODE]
        for part in parts:
            planes += _planes(part.runs, ROW_RUN_BYTES) + _planes(part.packets, SHADED_PACKET_BYTES)
        return self._compressors.at(level).compress(b"".join(planes))


class _Compressors:
    """By level of zstd; one thread at a time may use them."""

    def __init__(self) -> None:
        self._made: dict[int, zstandard.ZstdCompressor] = {}

    def at(self, level: int) -> zstandard.ZstdCompressor:
        if level not in self._made:
            self._made[level] = zstandard.ZstdCompressor(level=level)
        return self._made[level]


def _planes(memory: memoryview, size: int) -> list[bytes]:
    """The first bytes of all items of so many, then the second ones, and so on."""
    whole = bytes(memory)
    return [whole[n::size] for n in range(size)]


def coder_of(plan: FramePlan) -> BatchCoder | VoxelBatchCoder | None:
    """None if positions do not tell the plan's samples apart."""
    if plan.slabs is not None:
        return VoxelBatchCoder()
    try:
        return BatchCoder(plan)
    except ValueError:
        return None
