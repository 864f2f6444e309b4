"""What every launcher does: start servers, say how they are, end them, show their logs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec

from volsplat.deploy.server_command import Program
from volsplat.protocol.wire.tokens import Token


class ServerOrder(msgspec.Struct, frozen=True):
    """One server to start."""

    name: str  # unique within the cluster, as "node1 map/shade 2"
    program: Program
    arguments: tuple[str, ...]  # of the command, secrets left out; the launcher adds how the token comes


class StartedServer(msgspec.Struct, frozen=True):
    """A server that was started: kept in the cluster's state, enough for another process to ask after it and end it."""

    name: str
    place: str  # for people: its host, queue or pod
    handle: dict[str, str]  # the launcher's own: process id, job id, key …


class ServerState(Enum):
    QUEUED = "queued"
    RUNNING = "running"
    ENDED = "ended"
    UNKNOWN = "unknown"


class Said(NamedTuple):
    """How a server is, and why in words."""

    state: ServerState
    reason: str = ""


@dataclass(frozen=True)
class Secrets:
    """What servers must know that nobody else may. Never on a command line, in a log or in an error."""

    token: Token
    token_file: Path  # it lies there, on this machine


Report = Callable[[str], None]  # takes one line of progress


class Launcher(Protocol):
    """One machine's, or one engine's. All raise BadInput where a person must put something right."""

    def start(self, orders: Sequence[ServerOrder], secrets: Secrets, report: Report) -> list[StartedServer]:
        """Start them all, or none: if one cannot be started, those before it are ended again."""

    def states(self, servers: Sequence[StartedServer]) -> Mapping[str, Said]:
        """How each is, by name. One that cannot be asked is UNKNOWN, with the reason; nothing is raised for it."""

    def stop(self, servers: Sequence[StartedServer], report: Report) -> None:
        """End them. Returns once they have ended or been told to; those that ended before are no error.

        Where people end them, `report` hears how.
        """

    def logs(self, server: StartedServer, lines: int) -> str:
        """The last lines of what it printed."""
