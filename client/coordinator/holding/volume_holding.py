"""The volume's way into the map/shade servers: described, read, counted, packed, and who of them holds what.

A state machine like the coordinator, which hands it the answers of the servers: messages in, instructions out.
"""

from collections.abc import Mapping

from volsplat.client.coordinator.events.events import MessageReceived
from volsplat.client.coordinator.events.instructions import Instruction, PublishVolume, ReportLoss, ReportProgress, Send
from volsplat.client.coordinator.holding.assignments import NOTHING, Assignments, Held
from volsplat.client.coordinator.holding.base_level import LevelChoice
from volsplat.client.coordinator.holding.lending import Lending
from volsplat.client.coordinator.holding.packing import Packing
from volsplat.client.coordinator.holding.phase import SETTLED, SURVEYED_PHASES, Phase
from volsplat.client.coordinator.holding.stored_levels import StoredLevels
from volsplat.client.coordinator.holding.volume_survey import VolumeSurvey
from volsplat.client.coordinator.shares.moving_costs import MovingCosts
from volsplat.client.coordinator.shares.sub_cubes import divided
from volsplat.client.volume.survey_checks import check_survey
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Box, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.volume_messages import (
    ChangeSubCubes,
    DescribeVolume,
    HistogramsCounted,
    LendVolume,
    PackVoxels,
    PartHeld,
    PartRead,
    ReadAhead,
    ReadSubCubes,
    SubCubesRead,
    VolumeDescribed,
    VolumeLent,
    VoxelsPacked,
)
from volsplat.protocol.rules.levels import Resolution, Thinning, own_resolution, resolution_of
from volsplat.protocol.text.errors import VolsplatError


class VolumeHolding:
    """What is known of one volume, and which part of it each map/shade server holds in which form."""

    def __init__(self) -> None:
        self.phase = Phase.GATHERING
        self.assignments = Assignments()
        self.boxes: dict[int, list[Box]] = {}  # by map/shade server; of those that are there
        self.volume: SurveyedVolume | None = None
        self.packing: Packing | None = None  # what is held, or on its way
        self._path = ""
        self._held = True  # else only surveyed
        self._memory: dict[int, int] = {}  # of a prepared volume, for each of the servers that share it
        self._levels: StoredLevels | None = None  # of a prepared volume
        self._survey: VolumeSurvey | None = None
        self._pending: set[int] = set()  # servers whose answer the phase waits for
        self._lending: Lending | None = None  # while a volume that only comes whole is read
        self.costs = MovingCosts({})

    @property
    def _known(self) -> VolumeSurvey:
        """What is known of the volume so far, once it is described."""
        assert self._survey is not None
        return self._survey

    @property
    def assignment(self) -> int:
        """Held, or on its way."""
        return self.assignments.current

    @property
    def settled(self) -> bool:
        """Nothing is on its way: frames can be drawn, or their packets be made."""
        return self.phase in SETTLED

    def begin(self, path: str, memory: Mapping[int, int], held: bool = True) -> list[Instruction]:
        """Have these servers share the volume at `path`; not `held`, only survey it at first.

        `memory` is how many bytes of a prepared volume each of them may hold.
        """
        self.phase = Phase.DESCRIBING
        self._held = held
        self._path, self._memory = path, dict(memory)
        self.costs = MovingCosts(self._memory)
        return [
            ReportProgress("reading the volume's header"),
            Send(next(iter(memory)), DescribeVolume(path=path)),
        ]

    def outdated(self, message: Message) -> bool:
        """Whether it is about sub-cubes that nobody asks for any more."""
        return getattr(message, "assignment", self.assignment) != self.assignment

    def wanted(self, scene: Scene, step: Step, steady: bool = False) -> Packing:
        """What a step is drawn from. While a person moves through scenes, `steady` saves reading now and then.

        Raises BadInput where the volume was prepared by other rules.
        """
        assert self.volume is not None
        quantisation = self.volume.quantisation(scene.quantise)
        if self._levels is None:
            return Packing(quantisation)
        return self._levels.wanted(scene, step, quantisation, self.packing if steady else None)

    def holds(self, wanted: Packing) -> bool:
        """Whether the packets that are held, or on their way, serve what is wanted."""
        return self.packing is not None and self.packing.serves(wanted)

    def gives_way(self, wanted: Packing) -> bool:
        """Whether packets that are being read should be left for what is wanted: it does not wait for them."""
        if self.phase != Phase.PACKING or self._levels is None:
            return False
        return not self.holds(wanted) or self._levels.give_way(wanted)

    def prepare(self, packing: Packing) -> list[Instruction]:
        """Have these packets held.

        They are made from the source, which servers let go of once they have packed it, or were made before.
        """
        if self._levels is not None:
            return self._open_packets(self._levels, packing)
        if self.phase == Phase.SURVEYED and self._held:
            return self._pack(packing)
        self._held = True
        return self._read_sub_cubes()

    def resolution(self, step: Step, striding: bool, thinning: Thinning) -> Resolution:
        """What a step draws of the packets that are held."""
        assert self.volume is not None and self.packing is not None
        if self._levels is None:
            return own_resolution(self.volume.description.geometry, step, thinning)
        return resolution_of(step, self._levels.grids, self.packing.base_level, striding, thinning)

    def finest(self) -> Resolution:
        """The most that can be told of what is held."""
        assert self.volume is not None and self.packing is not None
        level = self.packing.level
        grid = self.volume.description.geometry if self._levels is None else self._levels.grids[level]
        return Resolution(level=level, geometry=grid, stride=1)

    def drawing(self, scene: Scene, step: Step, resolution: Resolution) -> Drawing:
        """What a step draws of the packets that are held. Raises ValueError where the scene does not fit the volume."""
        assert self.packing is not None
        return Drawing.planned(scene, step, self.description.geometry, self.packing.quantisation, resolution)

    @property
    def source(self) -> tuple[str, VolumeIdentity] | None:
        """The file that has the voxels' own values; of a prepared volume there is none."""
        return None if self._known.prepared is not None else (self._path, self._known.identity)

    @property
    def description(self) -> VolumeDescription:
        return self._known.description

    @property
    def may_move(self) -> bool:
        """Whether packets may change hands now, by servers that read no more than what they get."""
        return self.may_change and len(self.boxes) > 1

    @property
    def may_change(self) -> bool:
        """Whether others may get packets, or others than now hold them."""
        return self.phase == Phase.READY and self.assignments.may_move and self.changes_parts

    @property
    def changes_parts(self) -> bool:
        """Whether a server can read what it gets without reading the whole volume."""
        return self._levels is not None or self.description.reads_sub_cubes

    @property
    def reads_ahead(self) -> bool:
        """Whether servers can read beside frames what they are to hold. What was prepared comes coarse levels first."""
        return self.may_change and self._levels is None

    def to_read_ahead(self, reading: int, boxes: list[Box]) -> ReadAhead:
        """What one of them is asked for, so that it has the packets of these boxes."""
        assert self.packing is not None
        return ReadAhead(
            reading=reading,
            path=self._path,
            boxes=boxes,
            identity=self._known.identity,
            quantisation=self.packing.quantisation,
        )

    @property
    def packets_a_voxel(self) -> float:
        """How many are held, or on their way, for each voxel of the volume."""
        return 1.0 if self._levels is None else self._levels.packets_a_voxel

    def move(self, boxes: Mapping[int, Box]) -> list[Instruction]:
        """Have the packets change hands, so that each server holds this box."""
        assert self.may_move
        told = ReportProgress("sharing out the volume by what there is to do")
        return [told, *self._change({server: [box] for server, box in boxes.items()})]

    def share(self, boxes: Mapping[int, list[Box]], memory: Mapping[int, int]) -> list[Instruction]:
        """Have these servers hold these boxes, since others are there than before; what is held already stays.

        `memory` is what the new ones may hold of a prepared volume.
        """
        assert self.settled and self.volume is not None, "sub-cubes are on their way"
        self._memory.update(memory)
        if self.phase == Phase.READY and self.changes_parts:
            return self._change(boxes)
        if self.phase != Phase.EMPTY and self._levels is None and self._held:
            return self._read_sub_cubes(boxes)
        self.boxes.update(boxes)
        return []

    def _change(self, boxes: Mapping[int, list[Box]]) -> list[Instruction]:
        assert self.packing is not None
        if self._levels is not None:
            return self._open_packets(self._levels, self.packing, boxes)
        self._begin_assignment(boxes, moving=True)
        self.phase = Phase.PACKING
        identity, quantisation = self._known.identity, self.packing.quantisation
        changes = (
            ChangeSubCubes(
                assignment=self.assignment, path=self._path, boxes=held, identity=identity, quantisation=quantisation
            )
            for held in self.boxes.values()
        )
        return list(map(Send, self.boxes, changes))

    def lose(self, server: int) -> list[Instruction]:
        """Go on without this server."""
        del self.boxes[server]
        self._pending.discard(server)
        lending = self._lending
        if lending is not None and lending.lender == server and self.boxes:
            return self._read_sub_cubes()  # by another one
        self._go_on()
        return lending.lost(server) if lending is not None else []

    def lose_unsurveyed(self, server: int) -> list[Instruction]:
        """Go on without this server before the volume is surveyed: what others have counted of it counts no more.

        Without any other one the volume is to be asked for again.
        """
        describes = server == next(iter(self._memory))
        del self._memory[server]
        if not self._memory:
            self.phase, self._pending, self._lending = Phase.GATHERING, set(), None
            self.boxes.clear()
            return []
        if self.phase is Phase.DESCRIBING:
            return self.begin(self._path, self._memory, self._held) if describes else []
        self._known.begin()
        self._divide(self._known.description)
        return self._read_sub_cubes()

    def refused(self, server: int, request: str, held: int, error: VolsplatError) -> bool:
        """A server has refused the newest assignment by this error, and still holds the one that is `held`, 0 for none.

        Once all have answered, what they held is held again, where they all still do. True if somebody waited for it,
        for the first refusal.
        """
        first = self.assignments.refuse(server, held, error)
        self._pending.discard(server)
        if self._lending is not None:  # without it the others get nothing; before it lends they are asked for nothing
            kept = held if request == LendVolume.__name__ else 0
            self.assignments.refuse_all(self.boxes, kept)
            self._pending, self._lending = set(), None
        self._go_on()
        return first

    def _begin_assignment(self, boxes: Mapping[int, list[Box]] | None, moving: bool = False) -> None:
        """Of these boxes, or of those that the servers have. Nobody waits for packets that are `moving`."""
        if self.phase == Phase.READY:
            before: Held | None = Held(self.assignment, self.packing, dict(self.boxes))
        else:
            before = None if self.phase == Phase.EMPTY else NOTHING
        self.assignments.begin(before, moving)
        self.boxes.update(boxes or {})
        self._pending = set(self.boxes)

    def _end_refused(self) -> None:
        held = self.assignments.end_refused(self.boxes)
        self.phase, self.packing = Phase.READY if held.assignment else Phase.EMPTY, held.packing
        self.boxes.update({server: boxes for server, boxes in held.boxes.items() if server in self.boxes})
        if self._levels is not None:
            self._levels.refused(kept=bool(held.assignment))

    def described(self, message: VolumeDescribed, payload: memoryview) -> list[Instruction]:
        """Divide the volume among the servers, or as many of them as it has voxels."""
        self._survey = VolumeSurvey(message, payload)
        self._divide(message.description)
        told = self._spare()
        prepared = self._known.prepared
        if prepared is None:
            return [*told, *self._read_sub_cubes()]
        choice = LevelChoice(prepared.levels, self.boxes, self._memory)
        self._levels = StoredLevels(message.description.name, prepared.quantisation, choice)
        return [*told, *self._surveyed()]

    def _spare(self) -> list[Instruction]:
        """Let go of those for whom no voxel was left."""
        asked, voxels = len(self._memory), self._known.description.geometry.box.voxels
        for spare in self._memory.keys() - self.boxes.keys():
            del self._memory[spare]
        if len(self.boxes) == asked:
            return []
        few = f"the volume has fewer voxels ({voxels}) than there are map/shade servers ({asked})"
        return [ReportLoss(f"{few}; those that are left over hold nothing")]

    def _divide(self, description: VolumeDescription) -> None:
        boxes = divided(description.geometry, len(self._memory), description.chunk)
        self.boxes = {worker: [box] for worker, box in zip(self._memory, boxes, strict=False)}

    def _open_packets(
        self, levels: StoredLevels, packing: Packing, boxes: Mapping[int, list[Box]] | None = None
    ) -> list[Instruction]:
        self._begin_assignment(boxes, moving=boxes is not None)
        self.phase = Phase.PACKING
        self.packing, opened = levels.open(packing, self.assignment, self._path, self._known.identity, self.boxes)
        return opened

    def _read_sub_cubes(self, boxes: Mapping[int, list[Box]] | None = None) -> list[Instruction]:
        """Of these boxes, or of those that the servers have."""
        description, identity = self._known.description, self._known.identity
        self._begin_assignment(boxes)
        self.phase = Phase.READING
        self._lending = None
        said = f"reading the volume as {len(self.boxes)} sub-cubes" if len(self.boxes) > 1 else "reading the volume"
        if not description.reads_sub_cubes and len(self.boxes) > 1:
            self._lending = Lending(self.assignment, self._path, identity, self.boxes, description)
            return [ReportProgress(f"{said}, by one server for all"), *self._lending.begin()]
        read: list[Instruction] = []
        for worker, held in self.boxes.items():
            ask = ReadSubCubes(
                assignment=self.assignment, path=self._path, boxes=held, identity=identity, held=self._held
            )
            read.append(Send(worker, ask))
        return [ReportProgress(said), *read]

    # What a lender or receiver has under way when another one refuses still comes: then the volume is to be read again.

    @takes(VolumeLent, Phase.READING)
    def _lent(self, message: VolumeLent, event: MessageReceived) -> list[Instruction]:
        return self._lending.lent(message) if self._lending else []

    @takes(PartRead, Phase.READING, Phase.EMPTY)
    def _part_read(self, message: PartRead, event: MessageReceived) -> list[Instruction]:
        return self._lending.part_read(message, event.payload) if self._lending else []

    @takes(PartHeld, Phase.READING, Phase.EMPTY)
    def _part_held(self, message: PartHeld, event: MessageReceived) -> list[Instruction]:
        return self._lending.ask_next(event.server) if self._lending else []

    @takes(SubCubesRead, Phase.READING, Phase.EMPTY)
    def _sub_cubes_read(self, message: SubCubesRead, event: MessageReceived) -> list[Instruction]:
        check_survey(message.survey, self._voxels_of(event.server))
        self.costs.read(event.server, message.seconds, self._voxels_of(event.server))
        if self.volume is None:
            self._known.surveyed(message.survey)
        self._pending.discard(event.server)
        if not self._pending:
            self._lending = None
        if self.volume is None and not self._pending:
            return self._count()
        self._go_on()
        return []

    def _count(self) -> list[Instruction]:
        self.phase = Phase.COUNTING
        self._pending = set(self.boxes)
        count = self._known.count_request(self.assignment)
        return [ReportProgress("counting the histograms"), *(Send(worker, count) for worker in self.boxes)]

    @takes(HistogramsCounted, Phase.COUNTING)
    def _counted(self, message: HistogramsCounted, event: MessageReceived) -> list[Instruction]:
        self._known.counted(message, event.payload, self._voxels_of(event.server))
        self._pending.discard(event.server)
        return [] if self._pending else self._surveyed()

    def _voxels_of(self, server: int) -> int:
        return sum(box.voxels for box in self.boxes[server])

    def _surveyed(self) -> list[Instruction]:
        volume = self._known.volume()
        if volume is None:
            return self._count()
        self.phase, self.volume = Phase.SURVEYED, volume
        return [PublishVolume(self.volume)]

    def _pack(self, packing: Packing) -> list[Instruction]:
        self.packing = packing
        self.phase = Phase.PACKING
        self._pending = set(self.boxes)
        pack = PackVoxels(assignment=self.assignment, quantisation=packing.quantisation)
        return [ReportProgress("making voxel packets"), *(Send(worker, pack) for worker in self.boxes)]

    @takes(VoxelsPacked, Phase.PACKING)
    def _packed(self, message: VoxelsPacked, event: MessageReceived) -> list[Instruction]:
        if message.read:
            self.costs.read(event.server, message.seconds, message.read)
        elif not self.assignments.moving:
            self.costs.packed(event.server, message.seconds, self._voxels_of(event.server))
        self._pending.discard(event.server)
        self._go_on()
        return []

    def _go_on(self) -> None:
        """Leave a phase of a surveyed volume once every server has read again, or packed."""
        if self._pending:
            return
        self._lending = None
        if not self.boxes:  # the last one that held anything is gone
            self.phase, self.packing = Phase.EMPTY, None
            if self._levels is not None:
                self._levels.refused(kept=False)
            return
        if self.assignments.refused and self.phase in (Phase.READING, Phase.PACKING):
            return self._end_refused()
        match self.phase:
            case Phase.READING:
                self.phase, self.packing = Phase.SURVEYED, None
            case Phase.PACKING:
                self.phase = Phase.READY
                if self._levels is not None:
                    self._levels.opened()

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        phase, awaited = self.phase, self.phase in (Phase.READING, Phase.COUNTING, Phase.PACKING)
        assert self._pending <= self.boxes.keys(), "an answer of a server is awaited that holds nothing"
        assert awaited <= bool(self._pending) <= (not self.settled), f"{phase} waits for {self._pending or 'nobody'}"
        assert (self.volume is None) <= (phase not in (*SETTLED, Phase.PACKING)), "an unknown volume is held"
        assert (self.volume is not None) <= (phase in SURVEYED_PHASES), f"a known volume is {phase.value}"
        assert self.assignment <= self.assignments.newest, "an assignment is held that was never asked for"
        assert self.packing is not None or phase not in (Phase.PACKING, Phase.READY), "packets without rules"
        assert self._lending is None or (phase is Phase.READING and self._lending.lender in self.boxes), "a stray loan"
