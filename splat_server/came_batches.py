"""What has come over one data link of a frame."""

from collections import defaultdict
from dataclasses import dataclass, field

from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.splat_server.shared_batches import SharedBatches


@dataclass
class Came:
    """What has come over one link of the newest frame that it carries."""

    frame: int = 0
    batches: defaultdict[int, int] = field(default_factory=lambda: defaultdict(int))  # of each walker
    nbytes: int = 0
    decoding_seconds: float = 0.0
    shared: SharedBatches = field(default_factory=SharedBatches)

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

    def let_go(self) -> None:
        """Nothing more comes: memory that was shared goes with the last batch that lies in it."""
        self.shared = SharedBatches()
