"""Images in memory that the client sees: blocks of it which they are published in, by turns."""

import logging

from volsplat.protocol.messages.image_messages import ImagesTaken, SharedPixels
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.protocol.wire.shared_memory import FilledBlocks

BLOCKS = 5  # that of the frame, one that it is shown in meanwhile, one that the client shows, and two that it keeps

log = logging.getLogger(__name__)


class SharedImages:
    """One connection's. A memory is for images of one size. One thread calls it at a time."""

    def __init__(self) -> None:
        self._blocks: FilledBlocks | None = None
        self._memory = 0  # which, by its number
        self._told = False  # the client has its descriptor
        self._refused = False  # the system gives none

    def target(self, nbytes: int) -> memoryview | None:
        """Memory to publish an image of so many bytes in; None if the client holds all, or there is none."""
        if self._refused or not nbytes:
            return None
        if self._blocks is None or not self._blocks.suits(nbytes):
            self.close()
            try:
                self._blocks = FilledBlocks(BLOCKS, nbytes)
            except OSError as error:
                self._refused = True
                log.debug("images go by the socket: %s", error)
                return None
            self._memory, self._told = self._memory + 1, False
        block = self._blocks.free_block()
        return None if block is None else memoryview(block)[:nbytes]

    def hold(self, pixels: memoryview) -> bool:
        return self._blocks is not None and self._blocks.number_of(pixels) is not None

    def passed(self, pixels: memoryview) -> tuple[SharedPixels, int | None] | None:
        """What tells the client of an image, and the descriptor that goes with it; None for one that lies elsewhere."""
        blocks = self._blocks
        number = blocks.number_of(pixels) if blocks is not None else None
        if blocks is None or number is None:
            return None
        first, self._told = not self._told, True
        blocks.passed(number)
        shared = SharedPixels(self._memory, number, len(blocks), blocks.block_bytes, first)
        return shared, blocks.descriptor if first else None

    def freed(self, taken: ImagesTaken) -> None:
        """Raises RemoteProtocolError."""
        if taken.memory > self._memory:
            raise RemoteProtocolError(f"ImagesTaken.memory is {taken.memory}, but {self._memory} were shared")
        if taken.memory == self._memory and self._blocks is not None:
            self._blocks.freed(taken.freed)

    def close(self) -> None:
        if self._blocks is not None:
            self._blocks.close()
            self._blocks = None
