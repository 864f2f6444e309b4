"""Memory that a map/shade server of this machine has batches lie in."""

from volsplat.protocol.messages.messages import NO_BLOCK, Batch, BlocksFreed, BlocksShared
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.protocol.wire.shared_memory import ReadBlocks

BUNDLE = 3  # blocks that are told to be free at once


class SharedBatches:
    """One link's. Its receiving thread calls it."""

    def __init__(self) -> None:
        self._blocks: ReadBlocks | None = None
        self._freed: list[int] = []  # not told yet

    def share(self, message: BlocksShared, descriptor: int) -> None:
        """Takes the descriptor. Raises RemoteProtocolError."""
        blocks = ReadBlocks(descriptor, message.blocks, message.block_bytes)
        if self._blocks is not None:
            raise RemoteProtocolError("memory is shared for the second time")
        self._blocks = blocks

    def payload(self, batch: Batch, came: memoryview) -> memoryview:
        """Of the batch, which `came` unless it lies in a block. Raises RemoteProtocolError."""
        if batch.block == NO_BLOCK:
            return came
        if self._blocks is None:
            raise RemoteProtocolError(f"a batch lies in block {batch.block}, but no memory is shared")
        return memoryview(self._blocks.taken(batch.block))[: batch.raw_bytes]

    def news(self) -> BlocksFreed | None:
        """For the map/shade server; None if there is nothing new worth telling."""
        if self._blocks is not None:
            self._freed += self._blocks.freed()
        if len(self._freed) < BUNDLE:
            return None
        freed, self._freed = self._freed, []
        return BlocksFreed(freed)
