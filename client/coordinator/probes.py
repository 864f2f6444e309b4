"""Probes on their way, as the coordinator knows them: asked of every server that holds voxels, answered once by what
all of them have found.
"""

from collections.abc import Iterator

from volsplat.client.coordinator.coordinator_events import (
    Answer,
    Instruction,
    MessageReceived,
    PlaneAsked,
    ProbeAsked,
    Send,
    SliceAsked,
)
from volsplat.client.coordinator.open_questions import OpenQuestions
from volsplat.client.coordinator.phase import SURVEYED_PHASES
from volsplat.client.coordinator.probe_kinds import Asked, Probe, probe_for
from volsplat.client.coordinator.volume_holding import VolumeHolding
from volsplat.client.volume.computable import computable
from volsplat.protocol.description.scene import Step
from volsplat.protocol.messages.frame_messages import VoxelProbed
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.plane_messages import PlaneCounted
from volsplat.protocol.messages.slice_messages import SliceRead
from volsplat.protocol.text.errors import BadInput


class Probes(OpenQuestions[Probe]):
    """Each is answered as soon as no server is left that could add to it."""

    def __init__(self, holding: VolumeHolding) -> None:
        super().__init__()
        self._holding = holding

    @takes(ProbeAsked)
    def _point_asked(self, event: ProbeAsked) -> list[Instruction]:
        return self._begin(event)

    @takes(SliceAsked)
    def _slice_asked(self, event: SliceAsked) -> list[Instruction]:
        return self._begin(event)

    @takes(PlaneAsked)
    def _plane_asked(self, event: PlaneAsked) -> list[Instruction]:
        return self._begin(event)

    def _begin(self, event: Asked) -> list[Instruction]:
        """Take a probe, or refuse it if it does not fit the volume."""
        volume = self._holding.volume
        assert volume is not None, "who asks knows the volume"
        try:
            self._open[event.probe] = probe_for(event, volume)
        except BadInput as error:
            return [Answer(event.probe, error=error)]
        return []

    def waiting(self) -> Iterator[Probe]:
        """Those that no server was asked."""
        return (probe for probe in self._open.values() if probe.pending is None)

    def send(self) -> list[Instruction]:
        """Send the probes that wait and can be answered by what is packed; pack for the first that cannot."""
        sent: list[Instruction] = []
        holding = self._holding
        for probe in list(self.waiting()):
            if holding.volume is None or not holding.settled or not holding.boxes:
                break
            try:
                with computable():
                    packing = holding.wanted(probe.asked.scene, Step.F, steady=True)
            except BadInput as error:
                sent += self.refused(probe.asked.probe, error)
                continue
            held = holding.packing
            if held is None or (packing.quantisation != held.quantisation and not _takes_any(probe)):
                return sent + holding.prepare(packing)  # any level will do
            ask = probe.request(holding)
            probe.pending = set(holding.boxes)  # whose answers are waited for from now on
            sent += [Send(worker, ask) for worker in holding.boxes]
        return sent

    @takes(VoxelProbed, *SURVEYED_PHASES)
    def _voxel_probed(self, message: VoxelProbed, event: MessageReceived) -> list[Instruction]:
        return self._answered(message.probe, event)

    @takes(SliceRead, *SURVEYED_PHASES)
    def _slice_read(self, message: SliceRead, event: MessageReceived) -> list[Instruction]:
        return self._answered(message.probe, event)

    @takes(PlaneCounted, *SURVEYED_PHASES)
    def _plane_counted(self, message: PlaneCounted, event: MessageReceived) -> list[Instruction]:
        return self._answered(message.probe, event)

    def _answered(self, number: int, event: MessageReceived) -> list[Instruction]:
        probe = self._open.get(number)
        if probe is None or probe.pending is None or not probe.answered_by(event.message):
            return []
        probe.take(event.message, event.payload)
        probe.pending.discard(event.server)
        return [] if probe.pending else self._answer(number, probe.found)

    def lost(self, server: int) -> None:
        """Nothing more will come from this server: ask anew, of whoever then holds what it held."""
        for probe in self._open.values():
            if probe.pending is not None and server in probe.pending:
                probe.pending = None
                probe.forget()

    def validate_state(self, held_back: bool) -> None:
        """Raises AssertionError if an invariant is broken. Those that are `held_back` may wait."""
        if self._holding.settled and self._holding.boxes and not held_back:
            assert not list(self.waiting()), "a probe waits though the servers are ready"
        for probe in self._open.values():
            if probe.pending is not None:
                assert probe.pending, "a probe waits for nobody"
                assert probe.pending <= self._holding.boxes.keys(), "a probe waits for a server that holds nothing"


def _takes_any(probe: Probe) -> bool:
    """Whether any packets will do, by whatever rules they were made."""
    return isinstance(probe.asked, SliceAsked) and probe.asked.as_packed
