"""What was lost with a server is read by others beside frames, which show what is left, before it changes hands."""

from volsplat.client.coordinator.events.events import MessageReceived
from volsplat.client.coordinator.events.instructions import Instruction, ReportProgress, Send
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.shares.heirs import Boxes
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.volume_messages import AheadRead

READING_WHAT_WAS_LOST = "having others read what was lost"


class ReadingAhead:
    """Towards one division of the volume at a time."""

    def __init__(self, holding: VolumeHolding) -> None:
        self._holding = holding
        self._reading = 0  # the newest request's number
        self._towards: Boxes | None = None
        self._pending: set[int] = set()  # servers that have not read yet what they are to get

    def towards(self, boxes: Boxes) -> list[Instruction]:
        """Have these boxes read where they are not held yet; nothing if they are, or that cannot be."""
        if boxes == self._towards or not self._holding.reads_ahead:
            return []
        self._reading += 1
        asked = {server: self._holding.to_read_ahead(self._reading, held) for server, held in self._gaining(boxes)}
        self._towards, self._pending = dict(boxes), set(asked)
        told = ReportProgress(READING_WHAT_WAS_LOST)
        return [told, *(Send(server, request) for server, request in asked.items())]

    def goes_on(self, boxes: Boxes) -> bool:
        """Whether it is worth it to wait before they change hands."""
        return self._holding.reads_ahead and boxes == self._towards and bool(self._pending)

    @property
    def under_way(self) -> bool:
        return bool(self._pending)

    def lose(self, server: int) -> None:
        self._pending.discard(server)

    def refused(self, server: int) -> bool:
        """Whether what this server refuses is still wanted."""
        return server in self._pending

    def ends(self, boxes: Boxes | None = None) -> bool:
        """Nothing is to be read ahead any more. Whether these boxes have been."""
        read = boxes is not None and boxes == self._towards and not self._pending
        self._towards, self._pending = None, set()
        return read

    @takes(AheadRead)
    def _read(self, message: AheadRead, event: MessageReceived) -> list[Instruction]:
        if message.reading == self._reading:
            self._pending.discard(event.server)
        return []

    def _gaining(self, boxes: Boxes) -> list[tuple[int, list[Box]]]:
        """Servers that are to hold what they do not hold now."""
        held = self._holding.boxes
        return [(server, those) for server, those in boxes.items() if those != held.get(server)]

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        assert self._towards is not None or not self._pending, "parts are awaited that nobody is to hold"
