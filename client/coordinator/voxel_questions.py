"""Questions on their way, as the coordinator knows them: asked of every server that holds voxels, answered once by what
all of them have found.
"""

from collections.abc import Iterator

from volsplat.client.coordinator.events.events import MessageReceived, PlaneAsked, PointAsked, SliceAsked
from volsplat.client.coordinator.events.instructions import GiveAnswer, Instruction, Send
from volsplat.client.coordinator.holding.phase import SURVEYED_PHASES
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.open_questions import OpenQuestions
from volsplat.client.coordinator.voxel_question_kinds import Asked, VoxelQuestion, question_for
from volsplat.client.volume.computable import computable
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.messages.frame_messages import VoxelProbed
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.plane_messages import PlaneCounted
from volsplat.protocol.messages.slice_messages import SliceRead
from volsplat.protocol.text.errors import BadInput


class VoxelQuestions(OpenQuestions[VoxelQuestion]):
    """Each is answered as soon as no server is left that could add to it."""

    def __init__(self, holding: VolumeHolding) -> None:
        super().__init__()
        self._holding = holding

    @takes(PointAsked)
    @takes(SliceAsked)
    @takes(PlaneAsked)
    def _asked(self, event: Asked) -> list[Instruction]:
        """It waits, or is refused if it does not fit the volume."""
        volume = self._holding.volume
        assert volume is not None, "who asks knows the volume"
        try:
            self._open[event.question] = question_for(event, volume)
        except BadInput as error:
            return [GiveAnswer(event.question, error=error)]
        return []

    def waiting(self) -> Iterator[VoxelQuestion]:
        """Those that no server was asked."""
        return (question for question in self._open.values() if question.pending is None)

    def send(self) -> list[Instruction]:
        """Send those that wait and can be answered by what is packed; pack for the first that cannot."""
        sent: list[Instruction] = []
        holding = self._holding
        for question in list(self.waiting()):
            if holding.volume is None or not holding.settled or not holding.boxes:
                break
            try:
                with computable():
                    packing = holding.wanted(question.asked.scene, Step.F, steady=True)
            except BadInput as error:
                sent += self.refused(question.asked.question, error)
                continue
            held = holding.packing
            if held is None or (packing.quantisation != held.quantisation and not _takes_any(question)):
                return sent + holding.prepare(packing)  # any level will do
            ask = question.request(holding)
            question.pending = set(holding.boxes)  # whose answers are waited for from now on
            sent += [Send(worker, ask) for worker in holding.boxes]
        return sent

    @takes(VoxelProbed, *SURVEYED_PHASES)
    @takes(SliceRead, *SURVEYED_PHASES)
    @takes(PlaneCounted, *SURVEYED_PHASES)
    def _answered(self, message: VoxelProbed | SliceRead | PlaneCounted, event: MessageReceived) -> list[Instruction]:
        question = self._open.get(message.question)
        if question is None or question.pending is None or not question.answered_by(message):
            return []
        question.take(message, event.payload)
        question.pending.discard(event.server)
        return [] if question.pending else self._answer(message.question, question.found)

    def lost(self, server: int) -> None:
        """Nothing more will come from this server: ask anew, of whoever then holds what it held."""
        for question in self._open.values():
            if question.pending is not None and server in question.pending:
                question.pending = None
                question.forget()

    def validate_state(self, held_back: bool) -> None:
        """Raises AssertionError if an invariant is broken. Those that are `held_back` may wait."""
        if self._holding.settled and self._holding.boxes and not held_back:
            assert not list(self.waiting()), "a question waits though the servers are ready"
        for question in self._open.values():
            if question.pending is not None:
                assert question.pending, "a question waits for nobody"
                assert question.pending <= self._holding.boxes.keys(), (
                    "a question waits for a server that holds nothing"
                )


def _takes_any(question: VoxelQuestion) -> bool:
    """Whether any packets will do, by whatever rules they were made."""
    return isinstance(question.asked, SliceAsked) and question.asked.as_packed
