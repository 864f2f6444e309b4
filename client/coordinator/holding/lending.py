"""A volume that only comes whole, on its way from the one map/shade server that reads it to the others.

Servers dial nobody but the client, so the values pass through it, in parts: each receiver gets its next part once it
has kept the one before. So no more than one part for each receiver is on its way, whatever the volume's size.
"""

from collections import deque
from collections.abc import Mapping

from volsplat.client.coordinator.events.instructions import Instruction, ReportProgress, Send
from volsplat.protocol.description.volume import HALO, SCALAR_BYTES, Box, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.messages import ScalarType, VolumePart
from volsplat.protocol.text.errors import RemoteProtocolError

PART_BYTES = 4 << 20  # of values, at most: small enough that a few of them are nothing, large enough for a fast network


class Lending:
    """One reading of the volume for all servers. Messages in, instructions out."""

    def __init__(
        self,
        assignment: int,
        path: str,
        identity: VolumeIdentity,
        boxes: Mapping[int, list[Box]],
        description: VolumeDescription,
    ) -> None:
        """The first of the servers lends; `boxes` are what each is to hold."""
        self.lender = next(iter(boxes))
        self._assignment = assignment
        self._path = path
        self._identity = identity
        self._boxes = dict(boxes)
        self._description = description
        self._parts: dict[int, deque[VolumePart]] = {}  # to be asked for, by receiver

    def begin(self) -> list[Instruction]:
        lend = messages.LendVolume(assignment=self._assignment, path=self._path, identity=self._identity)
        return [Send(self.lender, lend)]

    def lent(self, message: messages.VolumeLent) -> list[Instruction]:
        """The lender has it: say what is to come to all others, and ask for the first part for each.

        Raises RemoteProtocolError where it has more or fewer scalars than it described.
        """
        described = 1 if self._description.second_scalar is None else 2
        if len(message.scalar_types) != described:
            raise RemoteProtocolError(f"it lends {len(message.scalar_types)} scalars of a volume that has {described}")
        told: list[Instruction] = [ReportProgress("handing the volume's parts to the servers")]
        for server, boxes in self._boxes.items():
            if server == self.lender:
                continue
            awaits = messages.AwaitParts(assignment=self._assignment, description=self._description, boxes=boxes)
            told.append(Send(server, awaits))
            self._parts[server] = deque(self._parts_of(server, boxes, message.scalar_types))
        if not self._parts:
            return self._end()  # every receiver was lost meanwhile
        return told + [more for server in list(self._parts) for more in self.ask_next(server)]

    def part_read(self, message: messages.PartRead, values: memoryview) -> list[Instruction]:
        """Pass a part on, in the memory that it came in."""
        server = message.part.server
        if server not in self._boxes:
            return []  # it was lost meanwhile
        return [Send(server, messages.HoldPart(assignment=self._assignment, part=message.part), values)]

    def ask_next(self, server: int) -> list[Instruction]:
        """Ask the lender for this receiver's next part; after the very last one it may let go of the volume."""
        if server not in self._parts:
            return []
        ask = messages.ReadPart(assignment=self._assignment, part=self._parts[server].popleft())
        if self._parts[server]:
            return [Send(self.lender, ask)]
        del self._parts[server]
        return [Send(self.lender, ask), *self._end()]

    def lost(self, server: int) -> list[Instruction]:
        """Go on without a receiver."""
        self._boxes.pop(server, None)
        return self._end() if self._parts.pop(server, None) else []

    def _end(self) -> list[Instruction]:
        if self._parts:
            return []
        boxes = self._boxes[self.lender]
        read = messages.ReadSubCubes(assignment=self._assignment, path=self._path, boxes=boxes, identity=self._identity)
        return [Send(self.lender, read)]

    def _parts_of(self, server: int, boxes: list[Box], scalar_types: list[ScalarType]) -> list[VolumePart]:
        dims = self._description.geometry.dims
        return [
            VolumePart(server=server, sub_cube=n, scalar=scalar, scalar_type=scalar_type, box=part)
            for n, box in enumerate(boxes)
            for scalar, scalar_type in enumerate(scalar_types)
            for part in parts_of(box if scalar else box.grown(HALO, dims), PART_BYTES // SCALAR_BYTES[scalar_type])
        ]


def parts_of(box: Box, voxels: int) -> list[Box]:
    """The box cut into as many whole sheets as have no more than so many voxels; or rows, or samples."""
    cut = [box]
    for axis in (2, 1, 0):
        step = max(voxels * cut[0].size[axis] // cut[0].voxels, 1)
        cut = [part for whole in cut for part in whole.layers(axis, step, box.low[axis])]
    return cut
