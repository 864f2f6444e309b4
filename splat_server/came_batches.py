"""What has come over one data link of a frame."""

import os
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

from volsplat.program.frame_spans import clock
from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import NoThread, RemoteProtocolError
from volsplat.protocol.wire.shared_memory import check_sealed
from volsplat.splat_server._kernels import BatchTaker, Bell
from volsplat.splat_server.merge import WorkerPart


@dataclass
class Came:
    """What has come over one link of the newest frame that it carries: by the socket, or through channels."""

    frame: int = 0
    batches: defaultdict[int, int] = field(default_factory=lambda: defaultdict(int))  # of each walker
    nbytes: int = 0
    decoding_seconds: float = 0.0
    taker: BatchTaker | None = None
    fault_told: bool = False

    def count(self, batch: messages.Batch, decoding_seconds: float) -> None:
        """Raises RemoteProtocolError where a batch is missing, comes twice, or belongs to an older frame."""
        if batch.frame < self.frame:
            raise RemoteProtocolError(f"a batch of frame {batch.frame} came after one of frame {self.frame}")
        if batch.frame > self.frame:
            self.frame, self.nbytes, self.decoding_seconds = batch.frame, 0, 0.0
            self.batches.clear()
        due = self.batches[batch.walker]
        if batch.sequence != due:
            raise RemoteProtocolError(
                f"Batch.sequence is {batch.sequence}, but {due} is due in frame {batch.frame}: a batch is missing or "
                "repeated"
            )
        self.batches[batch.walker] += 1
        self.nbytes += batch.payload_bytes()
        self.decoding_seconds += decoding_seconds

    def share(self, message: messages.ChannelsShared, descriptor: int, news: Bell) -> None:
        """Have batches taken out of channels. Takes the descriptor.

        Raises RemoteProtocolError, MemoryError, NoThread.
        """
        shape = message.walkers, message.blocks, message.block_bytes
        try:
            if self.taker is not None:
                raise RemoteProtocolError("channels are shared for the second time")
            check_sealed(descriptor, BatchTaker.memory_bytes(*shape))
            self.taker = BatchTaker(descriptor, *shape, news=news)
        except OSError as error:
            raise RemoteProtocolError(f"the channels' memory cannot be read: {error}") from error
        except NoThread:
            raise
        except RuntimeError as error:  # no room for it in this process
            raise MemoryError from error
        finally:
            os.close(descriptor)

    def follow(self, part: WorkerPart, traced: bool) -> None:
        """The link's worker has this part in the newest frame."""
        if self.taker is not None:
            self.frame = part.frame
            self.taker.begin(part.frame, part.into, part.sources.start, len(part.sources), traced)

    def nbytes_of(self, frame: int) -> int:
        """What has come of the frame, in bytes."""
        if self.frame != frame:
            return 0
        return self.taker.bytes if self.taker is not None else self.nbytes

    def spans(self) -> Iterator[tuple[float, float]]:
        """When batches were taken out of channels, by this process's clock."""
        now = clock()
        for _, began_ago, ended_ago in self.taker.spans if self.taker is not None else []:
            yield now - began_ago, now - ended_ago

    def give_up(self) -> None:
        """The running frame does without the link's worker."""
        if self.taker is not None:
            self.taker.begin(self.frame, None, 0, 0, False)

    def end(self) -> str:
        """The link has ended: what is in its channels is all that comes. The fault in it that was not told, if any."""
        if self.taker is None:
            return ""
        self.taker.close()
        self.taker.drain()
        fault, self.nbytes, self.taker = self.taker.fault, self.taker.bytes, None
        return "" if self.fault_told else fault

    def let_go(self) -> None:
        """Take nothing any more."""
        if self.taker is not None:
            self.taker.close()
            self.taker = None
