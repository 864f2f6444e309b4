"""What is done to a server, and whether it is lost by it."""

import signal
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import psutil

from volsplat.deploy.server_command import Program


class Network(Protocol):
    """A server's way to the others."""

    def go_down(self) -> None: ...
    def cut(self) -> None: ...
    def swallow(self) -> None: ...
    def slow_down(self, bytes_a_second: float) -> None: ...
    def delay(self, seconds: float) -> None: ...
    def lose(self, part: float) -> None: ...
    def heal(self) -> None: ...


class HarmedServer(Protocol):
    @property
    def program(self) -> Program: ...
    @property
    def process(self) -> psutil.Process: ...
    @property
    def network(self) -> Network: ...


@dataclass(frozen=True)
class Fault:
    """`harms` a server; one that is not `lasting` is undone by `heals` after some time."""

    name: str
    harms: Callable[[HarmedServer], None]
    heals: Callable[[HarmedServer], None] | None = None
    seconds: float = 0.0  # for which it lasts, if it is healed
    outlasts: bool = False  # the patience with a silent server, which so is lost before it is healed
    silent: bool = False  # nothing but silence tells of it

    @property
    def loses(self) -> bool:
        """Whether the session does without the server, for a while at least."""
        return self.lasting or self.outlasts

    @property
    def lasting(self) -> bool:
        return self.heals is None


def _link_down(server: HarmedServer) -> None:
    server.network.go_down()


def _killed(server: HarmedServer) -> None:
    server.process.send_signal(signal.SIGKILL)


def _stopped(server: HarmedServer) -> None:
    server.process.send_signal(signal.SIGSTOP)


def _goes_on(server: HarmedServer) -> None:
    server.process.send_signal(signal.SIGCONT)


def _network_healed(server: HarmedServer) -> None:
    server.network.heal()


FAULTS = (
    Fault("killed (kill -9)", _killed),
    Fault("frozen for good (SIGSTOP)", _stopped, silent=True),
    Fault("stopped for 0.7 s (SIGSTOP, SIGCONT)", _stopped, _goes_on, 0.7),
    Fault("link down for 0.7 s", _link_down, _network_healed, 0.7),
    Fault("connection cut", lambda server: server.network.cut()),
    Fault("half-open connection (all is swallowed)", lambda server: server.network.swallow(), silent=True),
    Fault("connection of 1 MB/s for 2 s", lambda server: server.network.slow_down(1e6), _network_healed, 2.0),
    Fault("200 ms of delay for 2 s", lambda server: server.network.delay(0.2), _network_healed, 2.0),
    Fault("5 % of the segments lost for 2 s", lambda server: server.network.lose(0.05), _network_healed, 2.0),
)
LINK_DOWN = Fault("link down for 5 s", _link_down, _network_healed, 5.0, outlasts=True)
