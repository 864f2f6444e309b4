"""Whether a link's batches are coded, and how: whatever has their bytes at its end soonest, by the rates measured."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from volsplat.mapshade_server.links.batch_coder import CLOSE, QUICK, BatchCoder, VoxelBatchCoder, coder_of
from volsplat.mapshade_server.links.shaded_part import ShadedPart
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.frame_plan import FramePlan

RAW = None  # not coded
LEAST_CODED = 4096  # bytes; of less, what a code says once for a batch takes too much
SHARE_OF_NEWEST = 0.25  # in an average
# After so many bytes for which nothing waited the link may have got faster: they then go raw until something waits.
BYTES_WITHOUT_WAIT = 256 << 20


@dataclass
class Cost:
    """Of a raw byte."""

    seconds: float  # to code it
    ratio: float  # of what travels

    def note(self, seconds: float, ratio: float) -> None:
        self.seconds += SHARE_OF_NEWEST * (seconds - self.seconds)
        self.ratio += SHARE_OF_NEWEST * (ratio - self.ratio)


class CodingChoice:
    """By what was sent so far over one link. Averages may lose a note if threads note at the same time.

    A send that waited ended when the network had taken all but a little. From one such to the next the link was busy,
    and what was sent between them is what it carried. If nothing waits, the link is no hindrance.
    """

    def __init__(self) -> None:
        self._costs: dict[int | None, Cost] = {RAW: Cost(0.0, 1.0), QUICK: Cost(1.1e-9, 0.4), CLOSE: Cost(1.8e-9, 0.28)}
        self.seconds_per_byte = 0.0  # of the link; 0 if it is no hindrance
        self._waited_at: float | None = None  # when a send last waited, in this frame
        self._since_wait = 0  # bytes sent
        self._without_wait = 0  # raw bytes, over frames

    @property
    def level(self) -> int | None:
        """For the next batch: of the compression, or RAW."""
        link = self.seconds_per_byte
        return min(self._costs, key=lambda level: self._costs[level].seconds + self._costs[level].ratio * link)

    def begin_frame(self) -> None:
        """The link has rested."""
        self._waited_at = None

    def coded(self, level: int, raw_bytes: int, coded_bytes: int, seconds: float) -> None:
        self._costs[level].note(seconds / raw_bytes, coded_bytes / raw_bytes)

    def sent(self, raw_bytes: int, sent_bytes: int, waited: bool, now: float) -> None:
        self._since_wait += sent_bytes
        if not waited:
            self._without_wait += raw_bytes
            if self._without_wait > BYTES_WITHOUT_WAIT:
                self.seconds_per_byte = 0.0
            return
        if self._waited_at is not None and self._since_wait:
            measured = (now - self._waited_at) / self._since_wait
            before = self.seconds_per_byte or measured
            self.seconds_per_byte = before + SHARE_OF_NEWEST * (measured - before)
        self._waited_at, self._since_wait, self._without_wait = now, 0, 0


class LinkCoding:
    """Codes the batches of one link."""

    def __init__(self) -> None:
        self.choice = CodingChoice()
        self._plan: FramePlan | None = None
        self._coders: dict[int, BatchCoder | VoxelBatchCoder | None] = {}  # of the frame, by walker

    def begin_frame(self, plan: FramePlan) -> None:
        self.choice.begin_frame()
        self._plan, self._coders = plan, {}

    def coded(self, batch: messages.Batch, parts: Sequence[ShadedPart]) -> bytes | None:
        """The batch's payload, or None if it goes raw."""
        level = self.choice.level
        coder = self._coder(batch.walker) if level is not RAW and batch.raw_bytes >= LEAST_CODED else None
        if level is RAW or coder is None:
            return None
        began = time.perf_counter()
        coded = coder.coded(parts, level)
        self.choice.coded(level, batch.raw_bytes, len(coded), time.perf_counter() - began)
        return coded

    def _coder(self, walker: int) -> BatchCoder | VoxelBatchCoder | None:
        assert self._plan is not None
        if walker not in self._coders:
            self._coders[walker] = coder_of(self._plan)
        return self._coders[walker]
