"""Voxels of the file that are asked for, on their way: of a server that holds them, and that may take its time.

What cannot be told soon is not told: nobody draws by it, and who looks at a voxel has its 8 bits.
"""

from collections import Counter

from volsplat.client.coordinator.coordinator_events import AnswerVoxel, Instruction, MessageReceived, Send, VoxelAsked
from volsplat.client.coordinator.phase import SURVEYED_PHASES
from volsplat.client.coordinator.volume_holding import VolumeHolding
from volsplat.client.volume.file_voxel import FileVoxel, check_is_voxel
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.value_messages import ReadVoxel, VoxelRead
from volsplat.protocol.text.errors import BadInput, VolsplatError

MOST_WAITING = 8  # for one server, which reads one after the other


class FileVoxels:
    """Every answer is given once."""

    def __init__(self, holding: VolumeHolding) -> None:
        self._holding = holding
        self._asked: dict[int, int] = {}  # the server that is to tell, by the number of the question

    @takes(VoxelAsked)
    def _ask(self, event: VoxelAsked) -> list[Instruction]:
        holding = self._holding
        assert holding.volume is not None, "who asks knows the volume"
        try:
            check_is_voxel(event.index, holding.description.geometry.dims)
        except BadInput as error:
            return [AnswerVoxel(event.probe, None, error)]
        server, volume = self._teller(event.index), holding.source
        if server is None or volume is None:
            return [AnswerVoxel(event.probe, None)]
        self._asked[event.probe] = server
        path, identity = volume
        return [Send(server, ReadVoxel(probe=event.probe, path=path, identity=identity, index=event.index))]

    def _teller(self, index: Index) -> int | None:
        """Who holds the voxel; of a volume that only comes whole the first one, so that one reads it alone."""
        holding = self._holding
        holders = [
            server
            for server, boxes in holding.boxes.items()
            if not holding.description.reads_sub_cubes or any(box.contains(index) for box in boxes)
        ]
        waiting = Counter(self._asked.values())
        return next((server for server in holders[:1] if waiting[server] < MOST_WAITING), None)

    @takes(VoxelRead, *SURVEYED_PHASES)
    def _read(self, message: VoxelRead, event: MessageReceived) -> list[Instruction]:
        if self._asked.pop(message.probe, None) is None:
            return []
        told = FileVoxel.of_bytes(message.scalar_types, event.payload) if message.scalar_types else None
        return [AnswerVoxel(message.probe, told)]

    def lost(self, server: int) -> list[Instruction]:
        """Nothing more will come from this server."""
        numbers = [number for number, teller in self._asked.items() if teller == server]
        for number in numbers:
            del self._asked[number]
        return [AnswerVoxel(number, None) for number in numbers]

    def refused(self, number: int, error: VolsplatError) -> list[Instruction]:
        """One ends in an error."""
        return [] if self._asked.pop(number, None) is None else [AnswerVoxel(number, None, error)]

    def failed(self, error: VolsplatError) -> list[Instruction]:
        """All end in an error."""
        return [told for number in list(self._asked) for told in self.refused(number, error)]

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        assert max(Counter(self._asked.values()).values(), default=0) <= MOST_WAITING, "too many wait for one server"
