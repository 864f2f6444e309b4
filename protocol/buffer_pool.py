"""Memory for received payloads that is used again, since fresh memory costs as much as receiving into it."""

import sys
import threading

from volsplat.protocol.messages import Message

SMALLEST = 1 << 12  # bytes; lengths are multiples of it and, where they are larger, of a quarter of a power of two
SPARE_BYTES = 32 << 20  # kept of each length where nobody holds them …
LEAST_SPARE, MOST_SPARE = 4, 16  # … but so many buffers at least and at most
REFERENCES = 2  # to a buffer that only the pool holds: its list and getrefcount's argument


def rounded_up(nbytes: int) -> int:
    quarter = max(SMALLEST, 1 << (nbytes - 1).bit_length() >> 3)
    return -(-nbytes // quarter) * quarter


def most_spare(length: int) -> int:
    return min(max(LEAST_SPARE, SPARE_BYTES // length), MOST_SPARE)


class BufferPool:
    """An Allocate (see framing). Any threads may call it.

    A buffer is free once no memoryview, tensor or kernel object refers to it any more.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards _buffers
        self._buffers: dict[int, list[bytearray]] = {}  # by length, all of them, in use or not

    def __call__(self, message: Message, nbytes: int) -> bytearray:
        length = rounded_up(nbytes)
        with self._lock:
            buffers = self._buffers.setdefault(length, [])
            spare = [n for n in range(len(buffers)) if sys.getrefcount(buffers[n]) <= REFERENCES]
            for n in reversed(spare[most_spare(length) :]):
                del buffers[n]
            if spare:
                return buffers[spare[0]]
            buffers.append(bytearray(length))
            return buffers[-1]
