"""What servers that have come say of themselves: how the link is, what their machine has, which volume they see."""

from typing import NamedTuple

from volsplat.deploy.cluster.state import KnownServer
from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.doctor.meeting import Meeting
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages.session_messages import DescribeMachine, MachineDescribed
from volsplat.protocol.messages.volume_messages import DescribeVolume, VolumeDescribed
from volsplat.protocol.text.byte_sizes import bytes_text
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection

SHOWN = 8  # digits of a checksum


class Seen(NamedTuple):
    """A volume as the first server sees it that could be asked."""

    by: str
    identity: VolumeIdentity
    levels: tuple[Geometry, ...]  # finest first


def joined(one: KnownServer, server: Connection) -> Finding:
    kind = "by TLS" if server.binding else "within this machine" if server.may_share_memory else "without TLS"
    way = "dialled" if one.wait_at else "it dials this machine"
    line = f"{way}, {kind}, knows the token, protocol version {server.peer.version}"
    return Finding(one.started.name, "link", right=True, line=line)


def machine(one: KnownServer, server: Connection, meeting: Meeting) -> tuple[Finding, int | None]:
    """Also its threads, if it answers."""
    try:
        told = meeting.ask(server, DescribeMachine(), MachineDescribed)
    except VolsplatError as error:
        return Finding(one.started.name, "machine", right=False, line=str(error)), None
    line = f"{told.threads} threads, {bytes_text(told.memory_bytes)} of memory left"
    return Finding(one.started.name, "machine", right=True, line=line), told.threads


def volume(
    one: KnownServer, server: Connection, meeting: Meeting, path: str, seen: Seen | None
) -> tuple[Finding, Seen | None]:
    """Whether it reads the volume, and the same one as `seen` before."""
    name = one.started.name
    try:
        told = meeting.ask(server, DescribeVolume(path), VolumeDescribed)
    except VolsplatError as error:
        return Finding(name, "volume", right=False, line=str(error)), seen
    if seen is not None and (difference := told.identity.difference(seen.identity)):
        line = f"another one than {seen.by} sees: {difference}; copy the same files to both machines"
        return Finding(name, "volume", right=False, line=line), seen
    line = f"{told.identity.size} bytes, sample's checksum {told.identity.contents[:SHOWN]}"
    same = "" if seen is None else f", as {seen.by} sees it"
    levels = told.prepared.levels if told.prepared else (told.description.geometry,)
    first = seen or Seen(name, told.identity, levels)
    return Finding(name, "volume", right=True, line=line + same), first
