"""What can be asked of the voxels that servers hold: what is seen at a point, a slice of the volume, counts.

Each knows what to ask of every server that holds voxels, and makes one answer of theirs.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

from volsplat.client.coordinator.events.events import PlaneAsked, PointAsked, SliceAsked
from volsplat.client.coordinator.events.instructions import Found
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.client.volume.computable import computable
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.frame_messages import ProbedVoxel, ProbeVoxels, VoxelProbed
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.plane_messages import CountPlane, PlaneCounted
from volsplat.protocol.messages.slice_messages import ReadSlice, SliceRead
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.line_of_sight import line_of_sight, sight_plan
from volsplat.protocol.rules.slice_plane import level_plane
from volsplat.protocol.rules.traversal import Traversal

Asked = PointAsked | SliceAsked | PlaneAsked


class VoxelQuestion(Protocol):
    """One of them, on its way."""

    pending: set[int] | None  # servers that were asked and have not answered; None before

    @property
    def asked(self) -> Asked: ...

    @property
    def found(self) -> Found:
        """The answer, once all have given theirs."""

    def request(self, holding: VolumeHolding) -> ProbeVoxels | ReadSlice | CountPlane:
        """What to ask all servers of the packets that they hold. Raises ValueError for what cannot be computed with."""

    def answered_by(self, message: Message) -> bool:
        """Whether it is of the boxes that are held now: before a loss a server may have held fewer."""

    def take(self, message: Message, payload: memoryview) -> None:
        """What one of them has found. Raises RemoteProtocolError for what cannot be."""

    def forget(self) -> None:
        """What was told: everybody is asked anew."""


@dataclass
class PointQuestion:
    """The front-most visible voxel at a point of the image."""

    asked: PointAsked
    traversal: Traversal
    pending: set[int] | None = None
    voxels: list[ProbedVoxel] = field(default_factory=list)

    @classmethod
    def of(cls, asked: PointAsked, geometry: Geometry) -> PointQuestion:
        """Of a scene that is settled. Raises ValueError if it does not fit the volume."""
        plan = sight_plan(asked.scene, geometry)
        line_of_sight(asked.scene, geometry, asked.x, asked.y).check(plan)
        return cls(asked, plan.traversal)

    @property
    def found(self) -> ProbedVoxel | None:
        return min(self.voxels, key=lambda voxel: self.traversal.place(voxel.index), default=None)

    def request(self, holding: VolumeHolding) -> ProbeVoxels:
        assert holding.packing is not None
        asked, geometry, resolution = self.asked, holding.description.geometry, holding.finest()
        plan = sight_plan(asked.scene, geometry, resolution)
        return ProbeVoxels(
            question=asked.question,
            assignment=holding.assignment,
            line=line_of_sight(asked.scene, geometry, asked.x, asked.y, resolution),
            drawing=Drawing.of(asked.scene, plan, geometry, holding.packing.quantisation, resolution.level),
        )

    def answered_by(self, message: Message) -> bool:
        return isinstance(message, VoxelProbed)

    def take(self, message: Message, payload: memoryview) -> None:
        assert isinstance(message, VoxelProbed)
        if message.voxel is not None:
            self.voxels.append(message.voxel)

    def forget(self) -> None:
        self.voxels.clear()


@dataclass
class SliceQuestion:
    """A slice, from all who hold a part of it."""

    asked: SliceAsked
    pending: set[int] | None = None
    slice: VolumeSlice | None = None  # once it was asked for
    assignment: int = 0  # by which it was asked for

    @classmethod
    def of(cls, asked: SliceAsked, geometry: Geometry) -> SliceQuestion:
        """Of a scene that is settled. Raises ValueError if it does not fit the volume."""
        level_plane(geometry.dims, (1, 1, 1), asked.axis, asked.index, asked.longest)
        plan_frame(asked.scene, geometry, Step.F)
        return cls(asked)

    @property
    def found(self) -> VolumeSlice | None:
        return self.slice

    def request(self, holding: VolumeHolding) -> ReadSlice:
        asked, drawing = self.asked, holding.drawing(self.asked.scene, Step.F, holding.finest())
        factors = drawing.plan.factors
        plane = level_plane(drawing.geometry.dims, factors, asked.axis, asked.index, asked.longest)
        self.slice, self.assignment = VolumeSlice.empty(plane, factors, drawing.quantisation), holding.assignment
        return ReadSlice(
            question=asked.question,
            assignment=holding.assignment,
            plane=plane,
            drawing=drawing,
        )

    def answered_by(self, message: Message) -> bool:
        return isinstance(message, SliceRead) and message.assignment == self.assignment

    def take(self, message: Message, payload: memoryview) -> None:
        assert isinstance(message, SliceRead) and self.slice is not None, "it was asked for"
        self.slice.take(message.parts, payload)

    def forget(self) -> None:
        self.slice = None


@dataclass
class PlaneQuestion:
    """How many voxels have each density with each strength, from all who hold some: whole numbers, so that it matters
    not how the volume is divided.
    """

    asked: PlaneAsked
    pending: set[int] | None = None
    counts: PlaneCounts = field(default_factory=PlaneCounts)
    assignment: int = 0  # by which they were asked for

    @property
    def found(self) -> PlaneCounts:
        return self.counts

    def request(self, holding: VolumeHolding) -> CountPlane:
        self.assignment = holding.assignment
        return CountPlane(self.asked.question, holding.assignment, holding.finest().level)

    def answered_by(self, message: Message) -> bool:
        return isinstance(message, PlaneCounted) and message.assignment == self.assignment

    def take(self, message: Message, payload: memoryview) -> None:
        self.counts = self.counts.plus(payload)

    def forget(self) -> None:
        self.counts = PlaneCounts()


def question_for(asked: Asked, volume: SurveyedVolume) -> VoxelQuestion:
    """Raises BadInput if what is asked for does not fit the volume."""
    geometry = volume.description.geometry
    with computable():
        settled = replace(asked, scene=volume.settled(asked.scene))
        match settled:
            case PointAsked():
                return PointQuestion.of(settled, geometry)
            case SliceAsked():
                return SliceQuestion.of(settled, geometry)
            case PlaneAsked():
                return PlaneQuestion(settled)
