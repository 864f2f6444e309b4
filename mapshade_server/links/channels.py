"""Memory that a splat server of this machine sees: each walker sends its batches through a channel of it."""

import logging
import os
from collections.abc import Sequence

from volsplat.mapshade_server._kernels import BatchChannel, ChannelMemory
from volsplat.protocol.messages.frame_messages import MOST_CHANNEL_BYTES
from volsplat.protocol.messages.messages import ChannelsShared
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.shared_memory import sealed_memory

LEAST_BLOCKS = 16  # of each walker: regions' owners need not go on together, and little of it is hidden by then
BLOCKS = 64  # of all walkers together: by turns a sheet has more for one owner than for the other
BLOCK_BYTES = 1 << 20  # holds the longest run; what is not touched of it costs nothing, and batches are small

log = logging.getLogger(__name__)


def shared_channels(link: Connection, walkers: int) -> Sequence[BatchChannel]:
    """A channel for each of so many walkers; none where no memory can be shared. Raises PeerLost."""
    if not link.may_share_memory:
        return []
    most = MOST_CHANNEL_BYTES // (walkers * BLOCK_BYTES)
    shape = walkers, min(max(LEAST_BLOCKS, BLOCKS // walkers), most), BLOCK_BYTES
    try:
        descriptor = sealed_memory(ChannelMemory.bytes(*shape))
    except OSError as error:
        log.debug("batches go by the socket: %s", error)
        return []
    try:
        memory = ChannelMemory(descriptor, *shape)
    except RuntimeError as error:
        log.debug("batches go by the socket: %s", error)
        os.close(descriptor)
        return []
    try:
        link.send(ChannelsShared(*shape), descriptor=descriptor)
    finally:
        os.close(descriptor)
    return [BatchChannel(memory, walker) for walker in range(walkers)]
