"""Probes on their way, as the coordinator knows them: asked of every server that holds voxels, answered by the
front-most one that is found.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

from volsplat.client.coordinator.coordinator_events import AnswerProbe, Instruction, ProbeAsked
from volsplat.protocol.description.scene import Step
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import Resolution
from volsplat.protocol.rules.line_of_sight import LineOfSight, line_of_sight
from volsplat.protocol.rules.shading_rule import shading_rule
from volsplat.protocol.text.errors import BadInput, VolsplatError


@dataclass
class _Probe:
    asked: ProbeAsked
    line: LineOfSight
    pending: set[int] | None = None  # servers that were asked and have not answered; None before
    found: list[messages.ProbedVoxel] = field(default_factory=list)

    @property
    def answer(self) -> AnswerProbe:
        front_most = min(self.found, key=lambda voxel: self.line.place(voxel.index), default=None)
        return AnswerProbe(self.asked.probe, front_most)


class Probes:
    """Every answer is given once, as soon as no server is left that could add to it."""

    def __init__(self) -> None:
        self._probes: dict[int, _Probe] = {}

    def add(self, asked: ProbeAsked, geometry: Geometry) -> list[Instruction]:
        """Take a probe, or refuse it where it does not fit the volume."""
        try:
            line = line_of_sight(asked.scene, geometry, asked.x, asked.y)
        except ValueError as error:
            return [AnswerProbe(asked.probe, None, BadInput(str(error)))]
        self._probes[asked.probe] = _Probe(asked, line)
        return []

    def waiting(self) -> Iterator[ProbeAsked]:
        """Those that no server was asked."""
        return (probe.asked for probe in self._probes.values() if probe.pending is None)

    def request(
        self,
        asked: ProbeAsked,
        servers: Collection[int],
        assignment: int,
        geometry: Geometry,
        packed_by: Quantisation,
        resolution: Resolution,
    ) -> messages.ProbeVoxels:
        """What to ask these servers, whose answers are waited for from now on."""
        self._probes[asked.probe].pending = set(servers)
        return messages.ProbeVoxels(
            probe=asked.probe,
            assignment=assignment,
            line=line_of_sight(asked.scene, geometry, asked.x, asked.y, resolution),
            shading=shading_rule(asked.scene, Step.F),
            geometry=geometry,
            quantisation=packed_by,
            level=resolution.level,
        )

    def received(self, server: int, message: messages.VoxelProbed) -> list[Instruction]:
        probe = self._probes.get(message.probe)
        if probe is None:
            return []
        probe.found += message.voxels
        return self._heard(server, [probe])

    def lost(self, server: int) -> list[Instruction]:
        """Nothing more will come from this server."""
        return self._heard(server, list(self._probes.values()))

    def refused(self, number: int, error: VolsplatError) -> list[Instruction]:
        """One ends in an error."""
        return [AnswerProbe(number, None, error)] if self._probes.pop(number, None) else []

    def failed(self, error: VolsplatError) -> list[Instruction]:
        """All end in an error."""
        return [instruction for number in list(self._probes) for instruction in self.refused(number, error)]

    def _heard(self, server: int, probes: list[_Probe]) -> list[Instruction]:
        answers: list[Instruction] = []
        for probe in probes:
            if probe.pending is None:
                continue
            probe.pending.discard(server)
            if not probe.pending:
                del self._probes[probe.asked.probe]
                answers.append(probe.answer)
        return answers
