"""Gives coded batches their bytes back (see docs/how_it_works/protocol.md)."""

from collections.abc import Sequence

import zstandard

from volsplat.protocol.messages.messages import BatchPart
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES
from volsplat.protocol.rules.sample_lattice import VOXEL_CODE
from volsplat.splat_server import _kernels


def decoded(coded: memoryview, parts: Sequence[BatchPart], room: memoryview) -> None:
    """Fill `room` with the payload that a raw batch with such parts has.

    Raises ValueError where the code is not one of them. Nothing is allocated before its size is known to be right.
    """
    counts = [(part.run_count, part.packet_count) for part in parts]
    largest = _kernels.largest_code(sum(runs for runs, _ in counts), sum(packets for _, packets in counts))
    try:
        size = zstandard.frame_content_size(coded)
        if not 0 <= size <= largest:
            raise ValueError(f"its code has {size} bytes, but {largest} at most are due")
        code = zstandard.ZstdDecompressor().decompress(coded, max_output_size=largest, allow_extra_data=False)
    except zstandard.ZstdError as fault:
        raise ValueError(f"its code cannot be decompressed: {fault}") from fault
    if code.startswith(VOXEL_CODE):
        _put_voxels(code, counts, room)
    else:
        _kernels.decode_batch(code, counts, room)


def _put_voxels(code: bytes, counts: Sequence[tuple[int, int]], room: memoryview) -> None:
    """Of a frame of slabs: all bytes are there, those of the same place in each run or packet together."""
    if len(code) != len(VOXEL_CODE) + len(room):
        raise ValueError(f"its code has {len(code) - len(VOXEL_CODE)} bytes of voxels, not {len(room)}")
    planes, begin = memoryview(code)[len(VOXEL_CODE) :], 0
    for runs, packets in counts:
        for count, size in ((runs, ROW_RUN_BYTES), (packets, SHADED_PACKET_BYTES)):
            end = begin + count * size
            items = bytearray(end - begin)
            for n in range(size):
                items[n::size] = planes[begin + n * count : begin + (n + 1) * count]
            room[begin:end] = items
            begin = end
