"""The splat server's loop: merges what map/shade servers send, splats it, and hands out the image at any time.

One thread works: it takes events from a queue, and while none is there it merges and splats, a few milliseconds at a
time, so that aborts and requests for the image never wait long. One thread receives from the client, and one from
each map/shade server; each of these stops reading while its connection's buffers are full, unless the merge waits
for just that server.
"""

import logging
import queue
import threading
import time
from dataclasses import dataclass, field

from volsplat.protocol import messages
from volsplat.protocol.connection import Connection, Listener
from volsplat.protocol.errors import RemoteProtocolError, VolsplatError
from volsplat.protocol.peak_memory import peak_memory
from volsplat.splat_server.frame_assembly import FrameAssembly
from volsplat.splat_server.image_buffer import ImageBuffer

log = logging.getLogger(__name__)

PACKETS_AT_ONCE = 65536  # merged and splatted between two looks at the queue: some milliseconds
