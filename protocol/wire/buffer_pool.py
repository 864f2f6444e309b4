"""Memory for received payloads that is used again, since fresh memory costs as much as receiving into it."""

import sys
import threading

from volsplat.protocol.messages.messages import Message

SMALLEST = 1 << 12  # bytes; lengths are multiples of it and, where they are larger, of a quarter of a power of two
SPARE_BYTES = 32 << 20  # kept of each length where nobody holds them …
LEAST_SPARE, MOST_SPARE = 4, 16  # … but so many buffers at least and at most
SPARE_OF_OTHERS = 128 << 20  # bytes kept of all other lengths together, when more of one length is needed
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
        # By length, all of them, in use or not; the lengths of which more were needed lately come last.
        self._buffers: dict[int, list[bytearray]] = {}

    def __call__(self, message: Message, nbytes: int) -> bytearray:
        length = rounded_up(nbytes)
        with self._lock:
            buffers = self._buffers.setdefault(length, [])
            spare = _spare(buffers)
            for n in reversed(spare[most_spare(length) :]):
                del buffers[n]
            if spare:
                return buffers[spare[0]]
            self._buffers[length] = self._buffers.pop(length)
            self._let_go_of_others(length)
            buffers.append(bytearray(length))
            return buffers[-1]

    def let_go(self) -> None:
        """Keep nothing: no more is received. Whoever holds a buffer keeps it."""
        with self._lock:
            self._buffers.clear()

    def _let_go_of_others(self, length: int) -> None:
        """Whoever sends all lengths by turns must not have much of each kept."""
        kept = 0
        for other in [other for other in reversed(self._buffers) if other != length]:
            buffers = self._buffers[other]
            for n in reversed(_spare(buffers)):
                if kept + other > SPARE_OF_OTHERS:
                    del buffers[n]
                else:
                    kept += other
            if not buffers:
                del self._buffers[other]


def _spare(buffers: list[bytearray]) -> list[int]:
    """The places of those that only the pool holds."""
    return [n for n in range(len(buffers)) if sys.getrefcount(buffers[n]) <= REFERENCES]
