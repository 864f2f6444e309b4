"""Probes on their way, as the coordinator knows them: asked of every server that holds voxels, answered by the
front-most one that is found.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from volsplat.client.coordinator.coordinator_events import (
    AnswerProbe,
    Instruction,
    MessageReceived,
    ProbeAsked,
    Send,
)
from volsplat.client.coordinator.phase import SURVEYED_PHASES
from volsplat.client.coordinator.volume_holding import VolumeHolding
from volsplat.protocol.description.scene import Step
from volsplat.protocol.messages.frame_messages import ProbedVoxel, ProbeVoxels, VoxelProbed
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import density_spread
from volsplat.protocol.rules.line_of_sight import LineOfSight, line_of_sight
from volsplat.protocol.rules.shading_rule import shading_rule
from volsplat.protocol.text.errors import BadInput, VolsplatError


@dataclass
class _Probe:
    asked: ProbeAsked
    line: LineOfSight
    pending: set[int] | None = None  # servers that were asked and have not answered; None before
    found: list[ProbedVoxel] = field(default_factory=list)

    @property
    def answer(self) -> AnswerProbe:
        front_most = min(self.found, key=lambda voxel: self.line.place(voxel.index), default=None)
        return AnswerProbe(self.asked.probe, front_most)


class Probes:
    """Every answer is given once, as soon as no server is left that could add to it."""

    def __init__(self, holding: VolumeHolding) -> None:
        self._holding = holding
        self._probes: dict[int, _Probe] = {}

    @takes(ProbeAsked)
    def _asked(self, event: ProbeAsked) -> list[Instruction]:
        """Take a probe, or refuse it if it does not fit the volume."""
        volume = self._holding.volume
        assert volume is not None, "who asks knows the volume"
        asked = replace(event, scene=volume.settled(event.scene))
        try:
            line = line_of_sight(asked.scene, volume.description.geometry, asked.x, asked.y)
        except ValueError as error:
            return [AnswerProbe(asked.probe, None, BadInput(str(error)))]
        self._probes[asked.probe] = _Probe(asked, line)
        return []

    def waiting(self) -> Iterator[ProbeAsked]:
        """Those that no server was asked."""
        return (probe.asked for probe in self._probes.values() if probe.pending is None)

    def send(self) -> list[Instruction]:
        """Send the probes that wait and can be answered by what is packed; pack for the first that cannot."""
        sent: list[Instruction] = []
        holding = self._holding
        for probe in list(self.waiting()):
            if holding.volume is None or not holding.settled or not holding.boxes:
                break
            try:
                packing = holding.wanted(probe.scene, Step.F, steady=True)
            except BadInput as error:
                sent += self.refused(probe.probe, error)
                continue
            except ValueError as error:
                sent += self.refused(probe.probe, BadInput(str(error)))
                continue
            if holding.packing is None or packing.quantisation != holding.packing.quantisation:
                return sent + holding.prepare(packing)  # any level will do
            ask = self._request(probe, packing.quantisation)
            sent += [Send(worker, ask) for worker in holding.boxes]
        return sent

    def _request(self, asked: ProbeAsked, packed_by: Quantisation) -> ProbeVoxels:
        """What to ask all servers, whose answers are waited for from now on."""
        holding = self._holding
        assert holding.volume is not None
        geometry, resolution = holding.volume.description.geometry, holding.finest()
        self._probes[asked.probe].pending = set(holding.boxes)
        return ProbeVoxels(
            probe=asked.probe,
            assignment=holding.assignment,
            line=line_of_sight(asked.scene, geometry, asked.x, asked.y, resolution),
            shading=shading_rule(asked.scene, Step.F, density_spread(geometry, resolution.geometry, packed_by)),
            geometry=geometry,
            quantisation=packed_by,
            level=resolution.level,
        )

    @takes(VoxelProbed, *SURVEYED_PHASES)
    def _received(self, message: VoxelProbed, event: MessageReceived) -> list[Instruction]:
        probe = self._probes.get(message.probe)
        if probe is None or probe.pending is None:
            return []
        probe.found += message.voxels
        probe.pending.discard(event.server)
        if probe.pending:
            return []
        del self._probes[message.probe]
        return [probe.answer]

    def lost(self, server: int) -> None:
        """Nothing more will come from this server: ask anew, of whoever then holds what it held."""
        for probe in self._probes.values():
            if probe.pending is not None and server in probe.pending:
                probe.pending = None
                probe.found.clear()

    def refused(self, number: int, error: VolsplatError) -> list[Instruction]:
        """One ends in an error."""
        return [AnswerProbe(number, None, error)] if self._probes.pop(number, None) else []

    def failed(self, error: VolsplatError) -> list[Instruction]:
        """All end in an error."""
        return [instruction for number in list(self._probes) for instruction in self.refused(number, error)]

    def validate_state(self, held_back: bool) -> None:
        """Raises AssertionError if an invariant is broken. Those that are `held_back` may wait."""
        if self._holding.settled and self._holding.boxes and not held_back:
            assert not list(self.waiting()), "a probe waits though the servers are ready"
        for probe in self._probes.values():
            if probe.pending is not None:
                assert probe.pending, "a probe waits for nobody"
                assert probe.pending <= self._holding.boxes.keys(), "a probe waits for a server that holds nothing"
