"""Memory that a splat server of this machine sees: batches lie in its blocks, and the link carries their numbers."""

import logging
from collections.abc import Sequence

from volsplat.mapshade_server._kernels import put_side_by_side
from volsplat.mapshade_server.links.shaded_batch import ShadedPart
from volsplat.protocol.messages.message import MOST_BLOCKS
from volsplat.protocol.messages.messages import BlocksShared
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.shared_memory import FilledBlocks

BLOCKS = 12  # of few walkers; with more, too much is hidden when it is read
WALKERS_BLOCKS = 4  # of each of many, whose batches are small
BLOCK_BYTES = 2 << 20  # what is not touched of it costs nothing
LEAST_BYTES = 16 << 10  # in a block: less goes as quickly by the socket

log = logging.getLogger(__name__)


class SharedBatches:
    """One link's. Any thread may call it.

    Nobody waits for a block: what finds none goes by the socket, where its walker waits while the splat server does not
    read. Waiting for a block could be without end: one walker's are free only once others' batches have come, too.
    """

    def __init__(self, link: Connection, walkers: int = 1) -> None:
        """For the batches of so many walkers. Raises PeerLost."""
        self._blocks: FilledBlocks | None = None
        if not link.may_share_memory:
            return
        try:
            self._blocks = FilledBlocks(min(max(BLOCKS, WALKERS_BLOCKS * walkers), MOST_BLOCKS), BLOCK_BYTES)
        except OSError as error:
            log.debug("batches go by the socket: %s", error)
            return
        try:
            link.send(BlocksShared(len(self._blocks), self._blocks.block_bytes), descriptor=self._blocks.descriptor)
        finally:
            self._blocks.close()

    def filled(self, parts: Sequence[ShadedPart]) -> int | None:
        """The block that these have been written to; None if they must go by the socket."""
        memories = [memory for part in parts for memory in (part.runs, part.packets)]
        nbytes = sum(len(memory) for memory in memories)
        if self._blocks is None or not LEAST_BYTES <= nbytes <= self._blocks.block_bytes:
            return None
        block = self._blocks.free_block()
        if block is None:
            return None
        room = memoryview(block)
        put_side_by_side(memories, room)
        number = self._blocks.number_of(room)
        assert number is not None
        self._blocks.passed(number)
        return number

    def freed(self, numbers: Sequence[int]) -> None:
        """Raises RemoteProtocolError where the splat server had none of them."""
        if self._blocks is None:
            raise RemoteProtocolError("blocks of shared memory are called free, but no memory is shared")
        self._blocks.freed(numbers)
