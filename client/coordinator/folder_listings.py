"""What lies in folders of the servers' machine, on its way: of any map/shade server, since all see the same files."""

from volsplat.client.coordinator.events.events import FolderAsked, MessageReceived
from volsplat.client.coordinator.events.instructions import GiveAnswer, Instruction, Send
from volsplat.client.coordinator.holding.phase import Phase
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.open_questions import AskedOfOne
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.folder_messages import FolderListed, ListFolder
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError

MOST_WAITING = 8  # answers, for all that look


class FolderListings(AskedOfOne):
    """Of whichever server is there. While servers are waited for, questions wait for the first of them."""

    def __init__(self, servers: Servers, holding: VolumeHolding) -> None:
        super().__init__()
        self._servers = servers
        self._holding = holding
        self._waiting: list[FolderAsked] = []

    @takes(FolderAsked)
    def _ask(self, event: FolderAsked) -> list[Instruction]:
        if len(self._open) + len(self._waiting) >= MOST_WAITING:
            return [
                GiveAnswer(event.question, error=BadInput("the servers are still busy with other folders; try again"))
            ]
        if not self._servers.ready(Role.MAPSHADE_SERVER) and self._holding.phase is not Phase.GATHERING:
            return [
                GiveAnswer(event.question, error=PeerLost("no map/shade server is there to look at folders; try again"))
            ]
        self._waiting.append(event)
        return self.send()

    def send(self) -> list[Instruction]:
        """Ask what waits, if there is somebody by now who can tell."""
        there = self._servers.ready(Role.MAPSHADE_SERVER)
        if not there:
            return []
        waiting, self._waiting = self._waiting, []
        self._open |= {one.question: there[0] for one in waiting}
        return [
            Send(there[0], ListFolder(question=one.question, path=one.root, folder=one.folder, words=one.words))
            for one in waiting
        ]

    @takes(FolderListed)
    def _listed(self, message: FolderListed, event: MessageReceived) -> list[Instruction]:
        return self._answer(message.question, message)

    def lost(self, server: int) -> list[Instruction]:
        """Nothing more will come from this server."""
        return self._end(server, PeerLost("the map/shade server that looked at the folder was lost; try again"))

    def failed(self, error: VolsplatError) -> list[Instruction]:
        """All end in an error, those that wait included."""
        waiting, self._waiting = self._waiting, []
        return [*super().failed(error), *(GiveAnswer(one.question, error=error) for one in waiting)]

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        assert len(self._open) + len(self._waiting) <= MOST_WAITING, "too many wait"
        assert not (self._waiting and self._servers.ready(Role.MAPSHADE_SERVER)), "nobody asks who is there"
        assert set(self._open.values()) <= self._servers.joined.keys(), "a server that is gone is waited for"
