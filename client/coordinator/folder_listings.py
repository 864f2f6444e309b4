"""What lies in folders of the servers' machine, on its way: of any map/shade server, since all see the same files."""

from volsplat.client.coordinator.coordinator_events import Answer, FolderAsked, Instruction, MessageReceived, Send
from volsplat.client.coordinator.open_questions import AskedOfOne
from volsplat.client.coordinator.phase import SURVEYED_PHASES
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.folder_messages import FolderListed, ListFolder
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost

MOST_WAITING = 8  # answers, for all that look


class FolderListings(AskedOfOne):
    """Of whichever server is there."""

    def __init__(self, servers: Servers) -> None:
        super().__init__()
        self._servers = servers

    @takes(FolderAsked)
    def _ask(self, event: FolderAsked) -> list[Instruction]:
        there = self._servers.ready(Role.MAPSHADE_SERVER)
        if not there:
            return [Answer(event.probe, error=PeerLost("no map/shade server is there to look at folders; try again"))]
        if len(self._open) >= MOST_WAITING:
            return [Answer(event.probe, error=BadInput("the servers are still busy with other folders; try again"))]
        self._open[event.probe] = there[0]
        ask = ListFolder(probe=event.probe, path=event.root, folder=event.folder, words=event.words)
        return [Send(there[0], ask)]

    @takes(FolderListed, *SURVEYED_PHASES)
    def _listed(self, message: FolderListed, event: MessageReceived) -> list[Instruction]:
        return self._answer(message.probe, message)

    def lost(self, server: int) -> list[Instruction]:
        """Nothing more will come from this server."""
        return self._end(server, PeerLost("the map/shade server that looked at the folder was lost; try again"))

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        assert len(self._open) <= MOST_WAITING, "too many wait"
        assert set(self._open.values()) <= self._servers.joined.keys(), "a server that is gone is waited for"
