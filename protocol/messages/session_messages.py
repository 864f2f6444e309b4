"""Messages about the session itself: what servers have, who links to whom, what cannot be done, and its end."""

from enum import StrEnum
from typing import Annotated

import msgspec
from msgspec import Meta

from volsplat.protocol.messages.message import (
    MAX_SERVERS,
    Count,
    Detail,
    IdOrNone,
    Line,
    Message,
    ServerId,
    ServerIds,
    Threads,
    asks,
    says,
)
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT, SPLAT_TO_DATA_LINK
from volsplat.protocol.text.printable import printable

WORKER_KEY_BYTES = 32
LONGEST_NAME = 64  # characters, of a session
LEAST_SILENCE, MOST_SILENCE = 0.5, 86400.0  # seconds

# Drawn by the client, for one worker and the splat servers.
WorkerKey = Annotated[bytes, Meta(min_length=WORKER_KEY_BYTES, max_length=WORKER_KEY_BYTES)]
Silence = Annotated[float, Meta(ge=LEAST_SILENCE, le=MOST_SILENCE)]
Port = Annotated[int, Meta(ge=1, le=65535)]


@says(CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT)
class NameSession(Message, frozen=True):
    """Client to map/shade server and splat server: what all processes of this session call it in their logs."""

    session: Annotated[str, Meta(max_length=LONGEST_NAME)]


class MachineDescribed(Message, frozen=True):
    """Map/shade server or splat server to client: the memory and the threads that it could take."""

    memory_bytes: Count
    threads: Threads


@asks(CLIENT_TO_MAPSHADE, MachineDescribed)
@asks(CLIENT_TO_SPLAT, MachineDescribed)
class DescribeMachine(Message, frozen=True):
    """Client to map/shade server and splat server: tell what your machine has left for you."""


@says(
    CLIENT_TO_MAPSHADE,
    CLIENT_TO_SPLAT,
    CLIENT_TO_MAPSHADE.back,
    CLIENT_TO_SPLAT.back,
    SPLAT_TO_DATA_LINK,
    of_connection=True,
)
class Alive(Message, frozen=True):
    """Either way: I am, though I have nothing to say.

    It is said where nothing else is for a quarter of the silence after which the other end would give this one up.
    `silence` is that of this end, in seconds.
    """

    silence: Silence


@says(CLIENT_TO_MAPSHADE.back, CLIENT_TO_SPLAT.back)
class LeaveSession(Message, frozen=True):
    """Map/shade server or splat server to client: I was told to end; let me go once others can do what I do.

    It serves on until EndSession comes, or for as long as it can wait.
    """


class Route(Detail, frozen=True):
    """Where a splat server takes data links, and the key that proves which worker the link is of."""

    server: ServerId
    host: Line
    port: Port
    key: WorkerKey


@says(CLIENT_TO_SPLAT)
class InviteWorkers(Message, frozen=True):
    """Client to splat server: take the data links of these workers, by their keys, and of no other.

    Nothing answers it. A link that comes before its invitation is closed, and its worker dials again.
    """

    keys: Annotated[dict[ServerId, WorkerKey], Meta(max_length=MAX_SERVERS)]


class ConnectedToSplatServers(Message, frozen=True):
    """Map/shade server to client: the data links to these splat servers stand; others are not reached."""

    servers: ServerIds


@asks(CLIENT_TO_MAPSHADE, ConnectedToSplatServers)
class ConnectToSplatServers(Message, frozen=True):
    """Client to map/shade server: have a data link to each of these splat servers and to no other."""

    routes: Annotated[list[Route], Meta(max_length=MAX_SERVERS)]


class Reason(StrEnum):
    """Why a request cannot be met."""

    REQUEST = "what was asked for"
    PEER_LOST = "another server is gone or cannot be reached"
    NO_ROOM = "want of memory, which other servers may have"


@says(CLIENT_TO_MAPSHADE.back, CLIENT_TO_SPLAT.back)
class Refused(Message, frozen=True):
    """Map/shade server or splat server to client: a request cannot be met, for the cause given in one line.

    `request` is the message's name; `frame`, `assignment` and `question` are the request's, 0 where it carries none.
    `held` is the assignment that a map/shade server still holds, 0 for none.
    """

    request: Line
    cause: Line
    reason: Reason = Reason.REQUEST
    frame: IdOrNone = 0
    assignment: IdOrNone = 0
    question: IdOrNone = 0
    held: IdOrNone = 0

    def __post_init__(self) -> None:
        for field in ("request", "cause"):  # they will be shown
            msgspec.structs.force_setattr(self, field, printable(getattr(self, field)))


@says(CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT, ends=True)
class EndSession(Message, frozen=True):
    """Client to map/shade server and splat server: the session is over, exit. Nothing follows it.

    With `another` the client begins one more at the same address at once: be found there instead.
    """

    another: bool = False
