"""What a map/shade server holds of the volume: its sub-cubes, and while others get theirs from it, all of it.

Takes the client's requests about the volume and gives the answers; knows no connection.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

from volsplat.mapshade_server.answers.volume_answers import (
    Answer,
    SurveyAnswers,
    check_within,
    counted,
    store_described,
)
from volsplat.mapshade_server.answers.voxel_answers import OfVoxels
from volsplat.mapshade_server.frames.slab_bound import most_needed
from volsplat.mapshade_server.held.kept_packets import packed_sub_cubes, stored_sub_cubes
from volsplat.mapshade_server.held.lent_volume import AwaitedParts, LentVolume, lent
from volsplat.mapshade_server.held.memory_budget import (
    LIST_BYTES,
    NEEDED,
    MemoryBudget,
    bytes_to_change,
    bytes_to_lend,
    bytes_to_read,
    bytes_to_walk_slabs,
)
from volsplat.mapshade_server.held.packet_store import names_store
from volsplat.mapshade_server.held.passed_box import PassedBox
from volsplat.mapshade_server.held.sheet_reader import sheet_reader
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.held.volume_identity import (
    check_still,
    checked_volume,
    described_store,
    described_volume,
    identified_store,
    identified_volume,
)
from volsplat.mapshade_server.held.wanted_reader import GivenUp, WantedReader
from volsplat.mapshade_server.parts_ahead import PartsAhead
from volsplat.mapshade_server.readers import VolumeReader
from volsplat.protocol.description.volume import Box
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.handlers import handlers, takes
from volsplat.protocol.rules.index_rules import Quantisation, Survey
from volsplat.protocol.text.errors import BadInput, NoRoom

NO_PAYLOAD = memoryview(b"")
ALL_THAT_IS_LEFT = MemoryBudget()


@dataclass(frozen=True)
class HeldOf:
    """Of what levels are: of a packet store, which has a path here, or of a volume's values."""

    store: str = ""
    identity: VolumeIdentity | None = None
    quantisation: Quantisation | None = None  # that values were packed by

    @property
    def packets(self) -> bool:
        return bool(self.store or self.quantisation)


NOTHING = HeldOf()


class PassedBoxes(NamedTuple):
    """Boxes that are surveyed, but not held."""

    boxes: list[PassedBox]
    check: Callable[[], None]  # raises BadInput if they are not of the volume that was described


class HeldVolume:
    """The sub-cubes of one assignment, and how they come here."""

    def __init__(self, budget: MemoryBudget = ALL_THAT_IS_LEFT) -> None:
        self.superseded: Callable[[int], bool] = lambda assignment: False  # whether any thread has made it out of date
        self._budget = budget
        self.assignment = 0
        self._levels: dict[int, list[SubCube]] = {}  # sub-cubes by level; level 0 alone if values were packed
        self._of = NOTHING  # what these are of
        self._surveyed: SurveyAnswers | None = None  # of that volume's values, which were packed
        self._again: messages.ReadSubCubes | None = None  # was answered by what a client before had read
        self._passed: PassedBoxes | None = None
        self._lent: LentVolume | None = None
        self._awaited: AwaitedParts | None = None
        self._ahead = PartsAhead(budget)

    def concerned(self, request: messages.Message) -> bool:
        """Whether the request is about the volume."""
        return type(request) in HANDLERS

    def answers(self, request: messages.Message, payload: memoryview = NO_PAYLOAD) -> list[Answer]:
        """Do what is asked, or no more of it once that is out of date. Raises BadInput if it cannot be done."""
        handler = HANDLERS[type(request)].method
        try:
            answers: list[Answer] = handler(self, request, payload) if payload else handler(self, request)
        except GivenUp:
            self._budget.taken()
            return []
        except BaseException:
            self._budget.taken()
            raise
        if type(request) in TAKEN_AFTER:
            self._budget.taken()
        return answers

    def keep(self) -> None:
        """The client is gone: keep what the next one may ask for, which is packets alone."""
        if not self._of.packets:
            self._drop()
        self._budget.taken()
        self._ahead.drop()
        self._lent, self._again, self._passed, self.assignment = None, None, None, 0

    def let_go(self) -> None:
        """Nothing is asked any more."""
        self._drop()
        self._budget.taken()

    @property
    def packed_bytes(self) -> int:
        return sum(4 * cube.box.voxels for cubes in self._levels.values() for cube in cubes)

    @contextmanager
    def room_to_walk(self, drawing: Drawing, sub_cubes: Sequence[SubCube]) -> Iterator[None]:
        """Raises NoRoom if there is none for the voxels that step G keeps of these. Within, no other server gets it."""
        if (slabs := drawing.plan.slabs) is None:
            yield
            return
        most = [cube.box.voxels for cube in sub_cubes]
        try:
            room = self._taken_for_slabs(sub_cubes, most)
        except NoRoom:  # for a solid; to know better, all packets are looked at once
            most = [most_needed(cube.block_densities, cube.box, drawing, slabs) for cube in sub_cubes]
            room = self._taken_for_slabs(sub_cubes, most)
        for cube, bytes_ in zip(sub_cubes, room, strict=True):
            cube.slab_room = bytes_
        try:
            yield
        finally:
            self._budget.taken()

    def _taken_for_slabs(self, sub_cubes: Sequence[SubCube], most: Sequence[int]) -> list[int]:
        """The room of each sub-cube of which so many voxels may be needed. Raises NoRoom."""
        room = [bytes_to_walk_slabs(cube.box, needed) for cube, needed in zip(sub_cubes, most, strict=True)]
        needed, kept = sum(room), sum(cube.slab_room for cube in sub_cubes)
        if needed > kept:
            held = self.packed_bytes + kept + sum(int(LIST_BYTES * cube.box.voxels) for cube in sub_cubes)
            budget = replace(self._budget, limit=None) if self._of.store else self._budget
            budget.take(needed, held, let_go=kept, use=NEEDED)
        return room

    def check(self, assignment: int, what: str) -> None:
        """Raises BadInput unless `what` can be made from what is held."""
        if assignment != self.assignment:
            raise BadInput(f"{what} is for assignment {assignment}, not {self.assignment}")

    def sub_cubes(self, level: int) -> list[SubCube]:
        """Those of a level. Raises BadInput if it is not held."""
        if level not in self._levels:
            raise BadInput(f"level {level} is not held, only {', '.join(map(str, sorted(self._levels))) or 'none'}")
        return self._levels[level]

    def sub_cubes_asked(self, request: messages.RenderFrame | OfVoxels) -> list[SubCube]:
        """Those that a request is about.

        Raises BadInput if they are not held, have another grid, or end before the bounds of what is drawn.
        """
        if isinstance(request, messages.RenderFrame | messages.SumDepths):
            self.check(request.assignment, f"frame {request.frame}")
        else:
            self.check(request.assignment, f"question {request.question}")
        if isinstance(request, messages.CountPlane):
            return self.sub_cubes(request.level)
        return self._sub_cubes_drawn(request.drawing)

    def _sub_cubes_drawn(self, drawing: Drawing) -> list[SubCube]:
        level, bounds, dims = drawing.level, drawing.plan.bounds, drawing.dims
        sub_cubes = self.sub_cubes(level)
        for sub_cube in sub_cubes:
            if sub_cube.geometry.dims != dims:
                raise BadInput(f"level {level} has {sub_cube.geometry.dims} voxels, not {dims}")
        if not bounds.within(Box((0, 0, 0), dims)):
            raise BadInput(f"the frame's bounds reach to {bounds.high}, but level {level} has {dims} voxels")
        return sub_cubes

    # -- from values

    @takes(messages.DescribeVolume)
    def _describe_volume(self, request: messages.DescribeVolume) -> list[Answer]:
        if names_store(request.path):
            return [store_described(*identified_store(request.path))]
        reader, identity = identified_volume(request.path)
        described = messages.VolumeDescribed(description=reader.description, prepared=None, identity=identity)
        return [Answer(described)]

    @takes(messages.ReadSubCubes)
    def _read_sub_cubes(self, request: messages.ReadSubCubes) -> list[Answer]:
        """From the volume that was lent to others, if it is that, which is let go; else from the file."""
        started = time.perf_counter()
        loan = self._loan(request.assignment)
        reader, check = (loan, _unchanged) if loan else checked_volume(request.path, request.identity)
        description = reader.description
        check_within(request.boxes, description.geometry)
        if not self.assignment and self._of.quantisation and self._surveyed and self._surveyed.answers(request):
            self._again, self.assignment = request, request.assignment
            return [self._surveyed.again(request.assignment)]
        if request.held:
            self._make_room(bytes_to_read(description, request.boxes))
        self._drop()  # nothing is held, should the reading fail
        reader = self._while_wanted(reader, request.assignment)
        if not request.held:
            sheets = sheet_reader(reader)
            self._passed = PassedBoxes([PassedBox(sheets, box) for box in request.boxes], check)
            return [self._read(self._passed.boxes, request.assignment, started)]
        sub_cubes = [SubCube(description.geometry, box, description.second_scalar) for box in request.boxes]
        for sub_cube in sub_cubes:
            sub_cube.read(reader)
        check()
        self._levels, self._of = {0: sub_cubes}, HeldOf(identity=request.identity)
        read = self._read(sub_cubes, request.assignment, started)
        self._surveyed = SurveyAnswers(request, read) if loan is None else None
        return [read]

    @takes(messages.LendVolume)
    def _lend_volume(self, request: messages.LendVolume) -> list[Answer]:
        reader = described_volume(request.path, request.identity)
        self._make_room(bytes_to_lend(reader.description))
        self._drop()
        loan = lent(self._while_wanted(reader, request.assignment), request.assignment)
        check_still(request.path, reader, request.identity)
        self._lent = loan
        return [Answer(messages.VolumeLent(assignment=request.assignment, scalar_types=loan.scalar_types))]

    @takes(messages.ReadPart)
    def _read_part(self, request: messages.ReadPart) -> list[Answer]:
        loan = self._loan(request.assignment)
        if loan is None:
            raise BadInput(f"a part is for assignment {request.assignment}, of which nothing is lent")
        read = messages.PartRead(assignment=request.assignment, part=request.part)
        return [Answer(read, (loan.part(request.part),))]

    def _loan(self, assignment: int) -> LentVolume | None:
        return self._lent if self._lent is not None and self._lent.assignment == assignment else None

    @takes(messages.AwaitParts)
    def _await_parts(self, request: messages.AwaitParts) -> list[Answer]:
        check_within(request.boxes, request.description.geometry)
        self._make_room(bytes_to_read(request.description, request.boxes))
        self._drop()
        self._awaited = AwaitedParts(request)
        return []

    @takes(messages.HoldPart)
    def _hold_part(self, request: messages.HoldPart, values: memoryview) -> list[Answer]:
        """Keep a part; with the last one comes the answer of all."""
        awaited = self._awaited
        if awaited is None or awaited.assignment != request.assignment:
            raise BadInput(f"a part is for assignment {request.assignment}, of which nothing is awaited")
        awaited.take(request.part, values)
        held = Answer(messages.PartHeld(assignment=request.assignment))
        if not awaited.complete:
            return [held]
        self._awaited = None
        self._levels = {0: awaited.sub_cubes()}
        return [held, self._read(self._levels[0], awaited.assignment, awaited.began)]

    @takes(messages.CountHistograms)
    def _count_histograms(self, request: messages.CountHistograms) -> list[Answer]:
        self.check(request.assignment, "the count of histograms")
        if self._surveyed is not None and (known := self._surveyed.counts(request)) is not None:
            return [known]
        if self._passed is not None:
            answer = counted(self._passed.boxes, request)
            self._passed.check()
            return [answer]
        answer = counted(self.sub_cubes(0), request)
        if self._surveyed is not None:
            self._surveyed.remember(request, answer)
        return [answer]

    @takes(messages.PackVoxels)
    def _pack_voxels(self, request: messages.PackVoxels) -> list[Answer]:
        started = time.perf_counter()
        self.check(request.assignment, "the packing")
        if self._again is not None:
            return self._pack_again(self._again, request, started)
        for sub_cube in self.sub_cubes(0):
            sub_cube.pack(request.quantisation)
        self._of = replace(self._of, quantisation=request.quantisation)
        return [_packed(request.assignment, started, read=0)]

    def _pack_again(self, asked: messages.ReadSubCubes, request: messages.PackVoxels, started: float) -> list[Answer]:
        """What a client before has left is there at once; only the rest is read."""
        packed = HeldOf(identity=asked.identity, quantisation=request.quantisation)
        held = self._held_of(packed)
        reader = described_volume(asked.path, asked.identity)
        needed = bytes_to_change(reader.description, asked.boxes, [cube.box for cube in held])
        self._budget.take(needed, self.packed_bytes, let_go=0 if held else self.packed_bytes)
        self._levels, self._again, self._of = {}, None, HeldOf(identity=asked.identity)
        wanted = self._while_wanted(reader, request.assignment)
        try:
            sub_cubes, read = packed_sub_cubes(wanted, request.quantisation, asked.boxes, held)
        except GivenUp:
            if held:  # for the client after this one
                self._levels, self._of = {0: held}, packed
            raise
        check_still(asked.path, reader, asked.identity)
        self._levels, self._of = {0: sub_cubes}, packed
        return [_packed(request.assignment, started, read)]

    @takes(messages.ChangeSubCubes)
    def _change_sub_cubes(self, request: messages.ChangeSubCubes) -> list[Answer]:
        """What is not wanted any more is let go once all the rest is there. One that has just joined holds nothing."""
        started = time.perf_counter()
        packed = HeldOf(identity=request.identity, quantisation=request.quantisation)
        held = [*self._held_of(packed), *self._ahead.cubes(request.identity, request.quantisation)]
        reader = described_volume(request.path, request.identity)
        description = reader.description
        check_within(request.boxes, description.geometry)
        needed = bytes_to_change(description, request.boxes, [cube.box for cube in held])
        self._budget.take(needed, self.packed_bytes, let_go=0)
        wanted = self._while_wanted(reader, request.assignment)
        sub_cubes, read = packed_sub_cubes(wanted, request.quantisation, request.boxes, held)
        check_still(request.path, reader, request.identity)
        self._levels, self.assignment = {0: sub_cubes}, request.assignment
        if self._of.identity != request.identity:
            self._surveyed = None
        self._of = packed
        self._ahead.drop()
        return [_packed(request.assignment, started, read)]

    def reading_ahead(self, request: messages.ReadAhead) -> Callable[[], None]:
        """See PartsAhead.begin."""
        packed = HeldOf(identity=request.identity, quantisation=request.quantisation)
        return self._ahead.begin(request, self._held_of(packed), lambda: self.superseded(self.assignment))

    def give_up_reading(self) -> None:
        """What is being read ahead."""
        self._ahead.drop()

    def _while_wanted(self, reader: VolumeReader, assignment: int) -> VolumeReader:
        return WantedReader(reader, lambda: self.superseded(assignment))

    def _held_of(self, packed: HeldOf) -> list[SubCube]:
        """The sub-cubes that are held, if they are of this volume by these rules."""
        return self._levels.get(0, []) if self._of == packed else []

    # -- from a packet store

    @takes(messages.OpenPackets)
    def _open_packets(self, request: messages.OpenPackets) -> list[Answer]:
        """What is held already stays; what is not wanted any more is let go before anything is read.

        Coarse levels come first. If a newer assignment is on its way, this one is given up without an answer.
        """
        started = time.perf_counter()
        store = described_store(request.path, request.identity)
        for one in request.levels:
            if one.level >= len(store.levels):
                raise BadInput(f"there is no level {one.level}: {request.path} has {len(store.levels)} levels")
            check_within(one.boxes, store.levels[one.level])
        kept, read = self._let_go_except(request), 0
        self._of = HeldOf(request.path, request.identity)
        for one in sorted(request.levels, key=lambda one: -one.level):
            try:
                self._levels[one.level], more = stored_sub_cubes(
                    store,
                    one.level,
                    one.boxes,
                    kept[one.level],
                    given_up=lambda: self.superseded(request.assignment),
                )
            except GivenUp:
                self._levels = kept | self._levels
                raise
            read += more
        check_still(request.path, store, request.identity)
        self.assignment = request.assignment
        return [_packed(request.assignment, started, read)]

    def _let_go_except(self, request: messages.OpenPackets) -> dict[int, list[SubCube]]:
        """Hold nothing any more; what reaches into what is wanted is in the answer, by level."""
        before = self._levels if self._of == HeldOf(request.path, request.identity) else {}
        self._drop()
        return {
            one.level: [cube for cube in before.get(one.level, []) if any(map(cube.box.common, one.boxes))]
            for one in request.levels
        }

    def _make_room(self, needed: int) -> None:
        """Raises BadInput if there is none, once all that is held is let go."""
        self._budget.take(needed, self.packed_bytes, let_go=self.packed_bytes)

    def _drop(self) -> None:
        self._levels, self._of, self.assignment = {}, NOTHING, 0
        self._surveyed, self._again = None, None
        self._lent, self._awaited, self._passed = None, None, None
        self._ahead.drop()

    def _read(self, sub_cubes: Sequence[SubCube | PassedBox], assignment: int, started: float) -> Answer:
        """The sub-cubes have their values, or know where to find them."""
        survey = reduce(Survey.joined, (sub_cube.survey() for sub_cube in sub_cubes))
        self.assignment = assignment
        seconds = time.perf_counter() - started
        return Answer(messages.SubCubesRead(assignment=assignment, survey=survey, seconds=seconds))


def _packed(assignment: int, started: float, read: int) -> Answer:
    return Answer(messages.VoxelsPacked(assignment=assignment, read=read, seconds=time.perf_counter() - started))


def _unchanged() -> None:
    """What was lent is in memory."""


HANDLERS = handlers(HeldVolume)
# After these nothing more is taken of the memory that was asked for. What others read is packed later, by PackVoxels.
TAKEN_AFTER = {messages.PackVoxels, messages.ChangeSubCubes, messages.LendVolume}
