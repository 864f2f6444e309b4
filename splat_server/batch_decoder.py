"""Gives coded batches their bytes back (see docs/protocol.md)."""

from collections.abc import Sequence

import lz4.block

from volsplat.protocol.messages.messages import BatchPart
from volsplat.splat_server import _kernels


def decoded(coded: memoryview, parts: Sequence[BatchPart], room: bytearray) -> memoryview:
    """The payload of a raw batch with such parts, in `room`, which has as many bytes at least.

    Raises ValueError where the code is not one of them.
    """
    counts = [(part.run_count, part.packet_count) for part in parts]
    largest = _kernels.largest_code(sum(runs for runs, _ in counts), sum(packets for _, packets in counts))
    try:
        code = lz4.block.decompress(coded, uncompressed_size=largest)
    except lz4.block.LZ4BlockError as fault:
        raise ValueError(f"its code cannot be unpacked: {fault}") from fault
    payload = memoryview(room)[: sum(part.bytes for part in parts)]
    _kernels.decode_batch(code, counts, payload)
    return payload
