"""Memory that two processes of one machine see, and its blocks that are used by turns: what one fills the other reads.

(Batches go through memory with an order of its own, see kernels/channels; what is sealed here serves for it, too.)

Who fills them makes the memory, and passes its descriptor once, with a message by their Unix socket (see connection);
only processes of one user are connected by that. Messages say which block has been filled, and notes in return which
ones are free again. The memory is sealed: neither can make it shorter under the other's hands.

A block is free where nobody refers to it: no memoryview, array, tensor or kernel object.
"""

import errno
import fcntl
import mmap
import os
import sys
import threading
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress

from volsplat.protocol.text.errors import RemoteProtocolError

SEALS = ("F_SEAL_SHRINK", "F_SEAL_GROW", "F_SEAL_SEAL")  # Linux has them, and no other system
REFERENCES = 2  # to a block that only its list holds: the list's, and getrefcount's argument


class FilledBlocks:
    """Those of the process that fills them. Any thread may call it."""

    def __init__(self, count: int, block_bytes: int) -> None:
        """Blocks of at least so many bytes. Raises OSError where the system shares no memory, or has none left."""
        self.block_bytes = _rounded(block_bytes)
        self.descriptor = sealed_memory(count * self.block_bytes)
        try:
            self._blocks = _mapped(self.descriptor, count, self.block_bytes)
        except BaseException:
            self.close()
            raise
        self._passed = Counter[int]()  # how often the other process has each block
        self._lock = threading.Lock()  # guards the one above

    def __len__(self) -> int:
        return len(self._blocks)

    def suits(self, nbytes: int) -> bool:
        """Whether blocks would be as large for so many bytes."""
        return self.block_bytes == _rounded(nbytes)

    def close(self) -> None:
        """Pass it on no more. The blocks stay for as long as somebody refers to them."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    def free_block(self) -> mmap.mmap | None:
        with self._lock:
            for number in _unreferenced(self._blocks):
                if not self._passed[number]:
                    return self._blocks[number]
        return None

    def number_of(self, memory: memoryview) -> int | None:
        """Of the block that the memory lies in, if it is one of these."""
        return next((number for number, block in enumerate(self._blocks) if memory.obj is block), None)

    def passed(self, number: int) -> None:
        """The other process is told of this block, once more."""
        with self._lock:
            self._passed[number] += 1

    def freed(self, numbers: Sequence[int]) -> None:
        """The other process holds these no more. Raises RemoteProtocolError where it held none."""
        with self._lock:
            self._passed.subtract(numbers)
            if wrong := [number for number in set(numbers) if self._passed[number] < 0]:
                raise RemoteProtocolError(f"block {wrong[0]} of the shared memory is called free, but was not passed")


class ReadBlocks:
    """Those of the process that reads them. Any thread may call it."""

    def __init__(self, descriptor: int, count: int, block_bytes: int) -> None:
        """Takes the descriptor. Raises RemoteProtocolError unless it is sealed memory of so many blocks."""
        try:
            check_sealed(descriptor, count * block_bytes)
            self._blocks = _mapped(descriptor, count, block_bytes)
        except (OSError, ValueError, OverflowError) as error:
            if isinstance(error, OSError) and error.errno == errno.ENOMEM:
                raise MemoryError from error
            raise RemoteProtocolError(f"the shared memory cannot be read: {error}") from error
        finally:
            os.close(descriptor)
        self._held = Counter[int]()
        self._lock = threading.Lock()  # guards the one above

    def taken(self, number: int) -> mmap.mmap:
        """A block that has been filled. Raises RemoteProtocolError where there is none of this number."""
        if number >= len(self._blocks):
            raise RemoteProtocolError(f"block {number} is named, but the shared memory has {len(self._blocks)}")
        with self._lock:
            self._held[number] += 1
            return self._blocks[number]

    def freed(self) -> list[int]:
        """Blocks that were taken and nobody refers to any more, each as often as it was taken."""
        with self._lock:
            freed = [number for number in _unreferenced(self._blocks) for _ in range(self._held.pop(number, 0))]
        return freed


def _rounded(nbytes: int) -> int:
    return -(-nbytes // mmap.ALLOCATIONGRANULARITY) * mmap.ALLOCATIONGRANULARITY


def sealed_memory(size: int) -> int:
    """The descriptor of new memory, all zeros. Raises OSError where the system shares none, or has none left."""
    if not all(hasattr(fcntl, seal) for seal in SEALS):
        raise OSError(f"{sys.platform} has no memory that may be shared safely")
    descriptor = os.memfd_create("volsplat", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        os.ftruncate(descriptor, size)
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, _bits())
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def check_sealed(descriptor: int, size: int) -> None:
    """Raises OSError or RemoteProtocolError. Memory that may shrink would end who reads it with SIGBUS."""
    if fcntl.fcntl(descriptor, fcntl.F_GET_SEALS) & _bits() != _bits():
        raise RemoteProtocolError("the shared memory is not sealed")
    if (has := os.fstat(descriptor).st_size) != size:
        raise RemoteProtocolError(f"the shared memory has {has} bytes, but {size} are announced")


def _bits() -> int:
    return sum(getattr(fcntl, seal) for seal in SEALS)


def _mapped(descriptor: int, count: int, block_bytes: int) -> list[mmap.mmap]:
    """Each block by itself, so that each tells who refers to it."""
    blocks = [mmap.mmap(descriptor, block_bytes, offset=number * block_bytes) for number in range(count)]
    for block in blocks:
        with suppress(OSError, AttributeError):  # a wish
            block.madvise(mmap.MADV_HUGEPAGE)
    return blocks


def _unreferenced(blocks: list[mmap.mmap]) -> list[int]:
    return [number for number in range(len(blocks)) if sys.getrefcount(blocks[number]) <= REFERENCES]
