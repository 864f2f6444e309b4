"""How the processes of lost servers ended, which this side alone knows of those that it started."""

from collections.abc import Callable, Iterator

from volsplat.client.coordinator.events.events import ServerLost
from volsplat.deploy.local import LocalServers
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import OWN_OUTPUT
from volsplat.protocol.wire.peer import Peer


class ProcessEnds:
    """Any thread may ask."""

    def __init__(self, local: LocalServers, newest_frame: Callable[[], int]) -> None:
        """`newest_frame` is the number of the frame that is waited for."""
        self._local = local
        self._newest_frame = newest_frame
        self._peers: dict[int, Peer] = {}  # all that ever joined; each is added by its receiving thread

    def joined(self, peer: Peer) -> None:
        self._peers[peer.id] = peer

    def told(self, message: messages.Message) -> Iterator[ServerLost]:
        """The losses of servers that the sender of a message calls lost, and whose processes have ended.

        Of an older frame workers are lost that went on to the newest one: nobody waits for them to end.
        """
        missed = self._missed(message)
        if not missed:  # as after nearly every message
            return
        ended = self._local.told_ends([peer.name for peer in missed])
        for peer in missed:
            if peer.name in ended:
                yield ServerLost(peer.id, f"{peer} is gone: it {ended[peer.name]}")

    def _missed(self, message: messages.Message) -> list[Peer]:
        match message:
            case messages.FrameFinished(frame=frame, lost=lost) if frame == self._newest_frame():
                return [self._peers[worker] for worker in lost if worker in self._peers]
            case messages.FrameMapped(frame=frame, lost=lost) if frame == self._newest_frame():
                return [self._peers[splat] for splat in lost if splat in self._peers]
            case messages.Refused(reason=messages.Reason.PEER_LOST):
                return [peer for peer in list(self._peers.values()) if peer.role == Role.SPLAT_SERVER]
        return []

    def cause_of_loss(self, peer: Peer, error: VolsplatError) -> str:
        """Why a server is lost, with how its process ended if that is known."""
        ended = self._local.told_ends([peer.name]) if OWN_OUTPUT in str(error) else {}
        return str(error).replace(OWN_OUTPUT, f"it {ended[peer.name]}") if ended else str(error)
