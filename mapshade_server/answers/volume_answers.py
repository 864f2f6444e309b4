"""Answers of a map/shade server about a volume, and what it remembers of those that hold for as long as the volume."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import NamedTuple

import msgspec
import numpy as np

from volsplat.mapshade_server.held.packet_store import PacketStore
from volsplat.mapshade_server.held.passed_box import PassedBox
from volsplat.mapshade_server.held.sub_cube import Histograms, SubCube
from volsplat.protocol.description.patches import PLANE_ENTRIES
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS
from volsplat.protocol.rules.levels import Prepared
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT
from volsplat.protocol.text.errors import BadInput


class Answer(NamedTuple):
    message: messages.Message
    payload: tuple[memoryview, ...] = ()

    @property
    def whole_payload(self) -> memoryview:
        """As it comes to the other side."""
        return memoryview(b"".join(self.payload))


@dataclass
class SurveyAnswers:
    """What was told of boxes when their values were here, which a server has let go of since."""

    asked: messages.ReadSubCubes
    read: Answer  # SubCubesRead
    counted: dict[messages.CountHistograms, Answer] = field(default_factory=dict)  # by request, as of assignment 1

    def answers(self, asked: messages.ReadSubCubes) -> bool:
        """Whether this is all of what is asked now."""
        return msgspec.structs.replace(asked, assignment=self.asked.assignment) == self.asked

    def again(self, assignment: int) -> Answer:
        """What was told when they were read, as the answer for another assignment."""
        return self.read._replace(message=msgspec.structs.replace(self.read.message, assignment=assignment))

    def remember(self, asked: messages.CountHistograms, answer: Answer) -> None:
        self.counted[msgspec.structs.replace(asked, assignment=1)] = answer

    def counts(self, asked: messages.CountHistograms) -> Answer | None:
        """The counts that were made before, as an answer to this."""
        answer = self.counted.get(msgspec.structs.replace(asked, assignment=1))
        if answer is None:
            return None
        return answer._replace(message=msgspec.structs.replace(answer.message, assignment=asked.assignment))


def check_within(boxes: Sequence[Box], geometry: Geometry) -> None:
    for box in boxes:
        if not box.within(geometry.box):
            raise BadInput(f"box {box.low} to {box.high} reaches beyond the volume of {geometry.dims} voxels")


def store_described(store: PacketStore, identity: VolumeIdentity) -> Answer:
    prepared = Prepared(
        survey=store.survey,
        quantisation=store.quantisation,
        levels=store.levels,
    )
    counts = [memoryview(array("q", each)).cast("B") for each in (store.density_counts, store.strength_counts)]
    described = messages.VolumeDescribed(description=store.description, prepared=prepared, identity=identity)
    return Answer(described, (*counts, memoryview(store.extremes.as_bytes())))


def counted(sub_cubes: Sequence[SubCube] | Sequence[PassedBox], request: messages.CountHistograms) -> Answer:
    """The counts of all of them together."""
    if not sub_cubes:
        raise BadInput("of the volume nothing is held here to count")
    density, strength, extremes = reduce(
        Histograms.joined, (each.histograms(request.low, request.high, request.max_gradient) for each in sub_cubes)
    )
    told = messages.HistogramsCounted(assignment=request.assignment, bins=HISTOGRAM_BINS, blocks=len(extremes.least))
    return Answer(told, (density.cast("B"), strength.cast("B"), memoryview(extremes.as_bytes())))


def plane_counts(sub_cubes: Sequence[SubCube]) -> memoryview:
    """How many voxels have each density together with each strength: uint64 (65536,), at density | strength << 8.

    Voxels without data do not count.
    """
    counts = np.zeros(PLANE_ENTRIES, np.uint64)
    for cube in sub_cubes:
        for sheet in np.asarray(memoryview(cube.packets)):
            there = sheet >> np.uint32(NO_DATA_BIT) == 0
            fields = (sheet if there.all() else sheet[there]) & np.uint32(PLANE_ENTRIES - 1)
            counts += np.bincount(fields.reshape(-1), minlength=PLANE_ENTRIES).astype(np.uint64)
    return counts.data
