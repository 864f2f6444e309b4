"""Memory for received payloads that is used again, since fresh memory costs as much as receiving into it."""

import sys
import threading

from volsplat.protocol.messages import Message

SMALLEST = 1 << 12  # bytes; lengths are rounded up to powers of two from here on
MOST_SPARE = 4  # buffers of one length that nobody holds; further ones are let go
REFERENCES = 2  # to a buffer that only the pool holds: its list and getrefcount's argument


class BufferPool:
    """An Allocate (see framing). Any threads may call it.

    A buffer is free once no memoryview, tensor or kernel object refers to it any more.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards _buffers
        self._buffers: dict[int, list[bytearray]] = {}  # by length, all of them, in use or not

    def __call__(self, message: Message, nbytes: int) -> bytearray:
        length = max(SMALLEST, 1 << (nbytes - 1).bit_length())
        with self._lock:
            buffers = self._buffers.setdefault(length, [])
            spare = [n for n in range(len(buffers)) if sys.getrefcount(buffers[n]) <= REFERENCES]
            for n in reversed(spare[MOST_SPARE:]):
                del buffers[n]
            if spare:
                return buffers[spare[0]]
            buffers.append(bytearray(length))
            return buffers[-1]
