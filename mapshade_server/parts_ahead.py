"""Packets that a map/shade server will be asked for, read beside frames: then its sub-cubes change at once."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from volsplat.mapshade_server.answers.volume_answers import check_within
from volsplat.mapshade_server.held.memory_budget import MemoryBudget, bytes_to_read
from volsplat.mapshade_server.held.sheet_reader import sheet_reader
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.held.volume_identity import check_still, described_volume
from volsplat.mapshade_server.held.wanted_reader import WantedReader
from volsplat.protocol.description.volume import Box
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages.volume_messages import ReadAhead
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.text.errors import BadInput


@dataclass
class _Parts:
    """What comes of one request."""

    identity: VolumeIdentity
    quantisation: Quantisation
    cubes: list[SubCube] = field(default_factory=list)  # as they are made
    given_up: bool = False
    over: threading.Event = field(default_factory=threading.Event)

    def as_asked(self, identity: VolumeIdentity, quantisation: Quantisation) -> bool:
        return (self.identity, self.quantisation) == (identity, quantisation)


class PartsAhead:
    """Of one request at a time, and what it takes over from the one before."""

    def __init__(self, budget: MemoryBudget) -> None:
        self._budget = budget
        self._parts: _Parts | None = None

    def begin(self, request: ReadAhead, held: Sequence[SubCube], given_up: Callable[[], bool]) -> Callable[[], None]:
        """What reads all of these boxes that is not held, for a thread of its own to call.

        That raises GivenUp if they are not wanted any more, which `given_up` may tell, BadInput if they cannot be read.
        """
        before, parts = self._parts, _Parts(request.identity, request.quantisation)
        self.drop()
        self._parts = parts
        boxes = [cube.box for cube in held]

        def read() -> None:
            try:
                if before is not None and before.as_asked(request.identity, request.quantisation):
                    before.over.wait()
                    parts.cubes += [cube for cube in before.cubes if any(map(cube.box.common, request.boxes))]
                self._read(request, parts, boxes, lambda: parts.given_up or given_up())
            except BadInput:
                parts.cubes.clear()  # of another volume, maybe
                raise
            finally:
                self._budget.taken()
                parts.over.set()

        return read

    def cubes(self, identity: VolumeIdentity, quantisation: Quantisation) -> list[SubCube]:
        """What is there of that volume by these rules, once what is being read of it is there as well."""
        parts = self._parts
        if parts is None or not parts.as_asked(identity, quantisation):
            return []
        parts.over.wait()
        return parts.cubes

    def drop(self) -> None:
        """Nothing of it is wanted any more. What is being read is given up soon."""
        if self._parts is not None:
            self._parts.given_up, self._parts = True, None

    def _read(self, request: ReadAhead, parts: _Parts, held: Sequence[Box], given_up: Callable[[], bool]) -> None:
        reader = described_volume(request.path, request.identity)
        description = reader.description
        check_within(request.boxes, description.geometry)
        there = [*held, *(cube.box for cube in parts.cubes)]
        rest = [part for box in request.boxes for part in box.without(*there)]
        self._budget.take(bytes_to_read(description, rest), held=0, let_go=0)
        wanted = sheet_reader(WantedReader(reader, given_up))
        for sheets in (sheets for box in rest for sheets in wanted.sheets(box)):
            sheets.sub_cube.pack(request.quantisation)
            parts.cubes.append(sheets.sub_cube)
        check_still(request.path, reader, request.identity)
