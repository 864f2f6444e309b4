"""What lies in folders of the servers' machine, on its way: of any map/shade server, since all see the same files."""

from volsplat.client.coordinator.coordinator_events import AnswerFolder, FolderAsked, Instruction, MessageReceived, Send
from volsplat.client.coordinator.phase import SURVEYED_PHASES
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.folder_messages import FolderListed, ListFolder
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError

MOST_WAITING = 8  # answers, for all that look


class FolderListings:
    """Every answer is given once."""

    def __init__(self, servers: Servers) -> None:
        self._servers = servers
        self._asked: dict[int, int] = {}  # the server that is to tell, by the number of the question

    @takes(FolderAsked)
    def _ask(self, event: FolderAsked) -> list[Instruction]:
        there = self._servers.ready(Role.MAPSHADE_SERVER)
        if not there:
            return [_ended(event.probe, PeerLost("no map/shade server is there to look at folders; try again"))]
        if len(self._asked) >= MOST_WAITING:
            return [_ended(event.probe, BadInput("the servers are still busy with other folders; try again"))]
        self._asked[event.probe] = there[0]
        ask = ListFolder(probe=event.probe, path=event.root, folder=event.folder, words=event.words)
        return [Send(there[0], ask)]

    @takes(FolderListed, *SURVEYED_PHASES)
    def _listed(self, message: FolderListed, event: MessageReceived) -> list[Instruction]:
        return [] if self._asked.pop(message.probe, None) is None else [AnswerFolder(message.probe, message)]

    def lost(self, server: int) -> list[Instruction]:
        """Nothing more will come from this server."""
        cause = PeerLost("the map/shade server that looked at the folder was lost; try again")
        numbers = [number for number, teller in self._asked.items() if teller == server]
        return [told for number in numbers for told in self.refused(number, cause)]

    def refused(self, number: int, error: VolsplatError) -> list[Instruction]:
        """One ends in an error."""
        return [] if self._asked.pop(number, None) is None else [_ended(number, error)]

    def failed(self, error: VolsplatError) -> list[Instruction]:
        """All end in an error."""
        return [told for number in list(self._asked) for told in self.refused(number, error)]

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        assert len(self._asked) <= MOST_WAITING, "too many wait"
        assert set(self._asked.values()) <= self._servers.joined.keys(), "a server that is gone is waited for"


def _ended(number: int, error: VolsplatError) -> AnswerFolder:
    return AnswerFolder(number, None, error)
