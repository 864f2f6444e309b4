"""The volume's way into the map/shade servers: described, read, counted, packed, and who of them holds what.

A state machine like the coordinator, which hands it the answers of the servers: messages in, instructions out.
Handlers are found by name: `_received_<message>`.
"""

from array import array
from collections.abc import Sequence
from enum import Enum, auto

from volsplat.client.coordinator_events import Instruction, PublishVolume, ReportProgress, Send
from volsplat.client.lending import Lending
from volsplat.client.sub_cubes import divided
from volsplat.client.surveyed_volume import SurveyedVolume
from volsplat.protocol import messages
from volsplat.protocol.errors import RemoteProtocolError
from volsplat.protocol.index_rules import HISTOGRAM_BINS, Quantisation, Survey
from volsplat.protocol.volume import Box, VolumeDescription


class Phase(Enum):
    GATHERING = auto()  # waiting for servers
    DESCRIBING = auto()
    READING = auto()  # sub-cubes
    COUNTING = auto()  # histograms
    SURVEYED = auto()  # scenes can be made, nothing is packed yet
    PACKING = auto()
    READY = auto()


class VolumeHolding:
    """What is known of one volume, and which part of it each map/shade server holds in which form."""

    def __init__(self) -> None:
        self.phase = Phase.GATHERING
        self.assignment = 0
        self.boxes: dict[int, list[Box]] = {}  # by map/shade server; of those that are there
        self.volume: SurveyedVolume | None = None
        self.quantisation: Quantisation | None = None  # by which it is packed
        self._path = ""
        self._enlisted: Sequence[int] = ()
        self._description: VolumeDescription | None = None
        self._survey: Survey | None = None
        self._density_counts: list[int] = []
        self._strength_counts: list[int] = []
        self._pending: set[int] = set()  # servers whose answer the phase waits for
        self._lending: Lending | None = None  # while a volume that only comes whole is read

    @property
    def settled(self) -> bool:
        """Nothing is on its way: frames can be drawn, or their packets be made."""
        return self.phase in (Phase.SURVEYED, Phase.READY)

    def begin(self, path: str, servers: Sequence[int]) -> list[Instruction]:
        """Have these servers share the volume at `path`."""
        self.phase = Phase.DESCRIBING
        self._path, self._enlisted = path, servers
        return [
            ReportProgress("reading the volume's header"),
            Send(servers[0], messages.DescribeVolume(path=path)),
        ]

    def takes(self, message: messages.Message) -> bool:
        """Whether the message is an answer to what is asked from here."""
        return hasattr(self, f"_received_{type(message).__name__}")

    def received(self, server: int, message: messages.Message, payload: memoryview) -> list[Instruction]:
        """Take an answer. Raises VolsplatError where the volume cannot be held."""
        handler = getattr(self, f"_received_{type(message).__name__}")
        instructions: list[Instruction] = handler(server, message, payload)
        return instructions

    def prepare(self, quantisation: Quantisation) -> list[Instruction]:
        """Have the voxels packed by these rules, from the source, which servers let go of once they have packed it."""
        return self._pack(quantisation) if self.phase == Phase.SURVEYED else self._read_sub_cubes()

    def lose(self, server: int) -> list[Instruction]:
        """Go on without this server, which is not the last one."""
        del self.boxes[server]
        self._pending.discard(server)
        lending = self._lending
        if lending is not None and lending.lender == server:
            return self._read_sub_cubes()  # by another one
        self._go_on()
        return lending.lost(server) if lending is not None else []

    def _received_VolumeDescribed(
        self, server: int, message: messages.VolumeDescribed, payload: memoryview
    ) -> list[Instruction]:
        self._description = message.description
        boxes = divided(message.description.geometry, len(self._enlisted))
        self.boxes = {worker: [box] for worker, box in zip(self._enlisted, boxes, strict=True)}
        return self._read_sub_cubes()

    def _read_sub_cubes(self) -> list[Instruction]:
        assert self._description is not None
        self.phase = Phase.READING
        self.assignment += 1
        self._pending = set(self.boxes)
        self._lending = None
        said = f"reading the volume as {len(self.boxes)} sub-cubes"
        if not self._description.reads_sub_cubes and len(self.boxes) > 1:
            self._lending = Lending(self.assignment, self._path, self.boxes, self._description)
            return [ReportProgress(f"{said}, by one server for all"), *self._lending.begin()]
        read: list[Instruction] = [
            Send(worker, messages.ReadSubCubes(assignment=self.assignment, path=self._path, boxes=boxes))
            for worker, boxes in self.boxes.items()
        ]
        return [ReportProgress(said), *read]

    def _received_VolumeLent(self, server: int, message: messages.VolumeLent, payload: memoryview) -> list[Instruction]:
        return lending.lent(message) if (lending := self._lending_for(message.assignment)) else []

    def _received_PartRead(self, server: int, message: messages.PartRead, payload: memoryview) -> list[Instruction]:
        return lending.part_read(message, payload) if (lending := self._lending_for(message.assignment)) else []

    def _received_PartHeld(self, server: int, message: messages.PartHeld, payload: memoryview) -> list[Instruction]:
        return lending.part_held(server) if (lending := self._lending_for(message.assignment)) else []

    def _lending_for(self, assignment: int) -> Lending | None:
        return self._lending if assignment == self.assignment else None

    def _received_SubCubesRead(
        self, server: int, message: messages.SubCubesRead, payload: memoryview
    ) -> list[Instruction]:
        if message.assignment != self.assignment:
            return []
        if self.volume is None:
            self._survey = message.survey if self._survey is None else self._survey.joined(message.survey)
        self._pending.discard(server)
        if not self._pending:
            self._lending = None
        if self.volume is None and not self._pending:
            return self._count()
        self._go_on()
        return []

    def _count(self) -> list[Instruction]:
        assert self._survey is not None
        self.phase = Phase.COUNTING
        self._pending = set(self.boxes)
        count = messages.CountHistograms(
            assignment=self.assignment,
            low=self._survey.low,
            high=self._survey.high,
            max_gradient=self._survey.max_gradient,
        )
        return [ReportProgress("counting the histograms"), *(Send(worker, count) for worker in self.boxes)]

    def _received_HistogramsCounted(
        self, server: int, message: messages.HistogramsCounted, payload: memoryview
    ) -> list[Instruction]:
        if message.assignment != self.assignment:
            return []
        if message.bins != HISTOGRAM_BINS:
            raise RemoteProtocolError(f"map/shade server {server} counted {message.bins} bins")
        counts = array("q", payload.tobytes())
        self._density_counts = _added(self._density_counts, counts[: message.bins])
        self._strength_counts = _added(self._strength_counts, counts[message.bins :])
        self._pending.discard(server)
        if self._pending:
            return []
        assert self._description is not None and self._survey is not None
        self.phase = Phase.SURVEYED
        self.volume = SurveyedVolume(self._description, self._survey, self._density_counts, self._strength_counts)
        return [PublishVolume(self.volume)]

    def _pack(self, quantisation: Quantisation) -> list[Instruction]:
        self.quantisation = quantisation
        self.phase = Phase.PACKING
        self._pending = set(self.boxes)
        pack = messages.PackVoxels(assignment=self.assignment, quantisation=quantisation)
        return [ReportProgress("making voxel packets"), *(Send(worker, pack) for worker in self.boxes)]

    def _received_VoxelsPacked(
        self, server: int, message: messages.VoxelsPacked, payload: memoryview
    ) -> list[Instruction]:
        if message.assignment == self.assignment:
            self._pending.discard(server)
            self._go_on()
        return []

    def _go_on(self) -> None:
        """Leave a phase of a surveyed volume once every server has read again, or packed."""
        if self._pending:
            return
        match self.phase:
            case Phase.READING:
                self.phase, self.quantisation = Phase.SURVEYED, None
            case Phase.PACKING:
                self.phase = Phase.READY


def _added(sums: list[int], counts: "array[int]") -> list[int]:
    return [a + b for a, b in zip(sums, counts, strict=True)] if sums else list(counts)
