"""What is known of the servers of a session: for a panel that shows them, and to say what is missing without one."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost

ANOTHER_SECONDS = 60.0  # that another server may take to join, where the last of its kind was started by hand


class VolumeIncomplete(PeerLost):
    """Servers are gone with their parts of the volume; what the others hold can still be drawn."""


class ImageIncomplete(PeerLost):
    """Servers are gone amid a frame; others take over, and can draw it anew."""


@dataclass(frozen=True)
class ServerState:
    """One server, as it stands."""

    id: int
    role: Role
    host: str  # where it dials from
    threads: int = 0  # that it may use; 0 until it has told, as the next one is
    memory_bytes: int = 0  # that its machine has left for it
    boxes: tuple[Box, ...] = ()  # what it holds of the volume, or held when it was lost
    lost: bool = False
    cause: str = ""  # how it was lost, in one line
    heirs: bool = True  # others can do its work, as far as is known
    alone: bool = False  # no other of its role was there when it was lost
    by_hand: bool = False  # nobody but a person may start another one in its place
    handed_over: bool = False  # others hold what it held, or will when what is on its way is there
    why_missing: str = ""  # why nobody takes that over

    @property
    def name(self) -> str:
        return f"{self.role} {self.id}"

    @property
    def is_known(self) -> bool:
        """Whether it has told what it has."""
        return self.threads > 0

    @property
    def voxels(self) -> int:
        return sum(box.voxels for box in self.boxes)


def missing_boxes(servers: Iterable[ServerState]) -> tuple[Box, ...]:
    """The parts of the volume that were lost with their servers."""
    return tuple(box for server in servers if server.lost and not server.handed_over for box in server.boxes)


def incomplete(servers: Iterable[ServerState]) -> VolumeIncomplete:
    """One line: which of these servers were lost, what of the volume with them, and why nobody takes that over."""
    lost = [server for server in servers if missing_boxes([server])]
    causes = "; ".join(server.cause for server in lost)
    why = "".join(f"; nobody takes over: {why}" for why in dict.fromkeys(server.why_missing for server in lost) if why)
    return VolumeIncomplete(f"{causes}; {part_of_volume(missing_boxes(lost))} of the volume are missing{why}")


def handed_over(lost: ServerState) -> str:
    """One line that says which server was lost, and who does its work: others, or one that is yet to come."""
    if not lost.heirs:
        return lost.cause
    if lost.boxes:
        what = f"{part_of_volume(lost.boxes)} of the volume"
    else:
        what = f"its part of the {'image' if lost.role is Role.SPLAT_SERVER else 'volume'}"
    heirs = _awaited(lost) if lost.alone else "others take over"
    return f"{lost.cause}; {heirs} {what}"


def _awaited(lost: ServerState) -> str:
    if lost.by_hand:
        return f"another {lost.role} that joins within {ANOTHER_SECONDS:g} s takes over"
    return "another one is started in its place and takes over"


def losses(servers: Sequence[ServerState]) -> dict[int, str]:
    """What is to be told of each server that was lost, in a session that goes on."""
    return {server.id: _told(server) for server in servers if server.lost}


def _told(lost: ServerState) -> str:
    if not missing_boxes([lost]):
        return handed_over(lost)
    return f"{incomplete([lost])}; {_awaited(lost)}" if lost.alone else str(incomplete([lost]))


def part_of_volume(boxes: Iterable[Box]) -> str:
    """These boxes for a person: the first and the last voxel of each on every axis."""
    return " and ".join(_ranges(box) for box in boxes)


def _ranges(box: Box) -> str:
    return ", ".join(f"{axis} {low}-{high - 1}" for axis, low, high in zip("ijk", box.low, box.high, strict=True))
