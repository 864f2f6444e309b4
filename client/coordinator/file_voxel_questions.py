"""Voxels of the file that are asked for, on their way: of a server that holds them, and that may take its time.

What cannot be told soon is not told: nobody draws by it, and who looks at a voxel has its 8 bits.
"""

from collections import Counter

from volsplat.client.coordinator.events.events import FileVoxelAsked, MessageReceived
from volsplat.client.coordinator.events.instructions import GiveAnswer, Instruction, Send
from volsplat.client.coordinator.holding.phase import SURVEYED_PHASES
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.open_questions import AskedOfOne
from volsplat.client.volume.file_voxel import FileVoxel, check_is_voxel
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.value_messages import ReadVoxel, VoxelRead
from volsplat.protocol.text.errors import BadInput

MOST_WAITING = 8  # for one server, which reads one after the other


class FileVoxelQuestions(AskedOfOne):
    """Of whatever holds the volume."""

    def __init__(self, holding: VolumeHolding) -> None:
        super().__init__()
        self._holding = holding

    @takes(FileVoxelAsked)
    def _ask(self, event: FileVoxelAsked) -> list[Instruction]:
        holding = self._holding
        assert holding.volume is not None, "who asks knows the volume"
        try:
            check_is_voxel(event.index, holding.description.geometry.dims)
        except BadInput as error:
            return [GiveAnswer(event.question, error=error)]
        server, volume = self._teller(event.index), holding.source
        if server is None or volume is None:
            return [GiveAnswer(event.question)]
        self._open[event.question] = server
        path, identity = volume
        return [Send(server, ReadVoxel(question=event.question, path=path, identity=identity, index=event.index))]

    def _teller(self, index: Index) -> int | None:
        """Who holds the voxel; of a volume that only comes whole the first one, so that one reads it alone."""
        holding = self._holding
        holders = [
            server
            for server, boxes in holding.boxes.items()
            if not holding.description.reads_sub_cubes or any(box.contains(index) for box in boxes)
        ]
        waiting = Counter(self._open.values())
        return next((server for server in holders[:1] if waiting[server] < MOST_WAITING), None)

    @takes(VoxelRead, *SURVEYED_PHASES)
    def _read(self, message: VoxelRead, event: MessageReceived) -> list[Instruction]:
        told = FileVoxel.of_bytes(message.scalar_types, event.payload) if message.scalar_types else None
        return self._answer(message.question, told)

    def lost(self, server: int) -> list[Instruction]:
        """Nothing more will come from this server."""
        return self._end(server, None)

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        assert max(Counter(self._open.values()).values(), default=0) <= MOST_WAITING, "too many wait for one server"
