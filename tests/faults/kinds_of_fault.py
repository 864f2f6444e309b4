"""What is done to a server, and whether it is lost by it."""

import signal
from collections.abc import Callable
from dataclasses import dataclass

from faults.servers_at_hand import HarmedServer


@dataclass(frozen=True)
class Fault:
    """`harms` a server; one that is not `lasting` is undone by `heals` after some time, and the server must live."""

    name: str
    harms: Callable[[HarmedServer], None]
    heals: Callable[[HarmedServer], None] | None = None
    seconds: float = 0.0  # for which it lasts, if it is healed
    silent: bool = False  # nothing but silence tells of it

    @property
    def lasting(self) -> bool:
        return self.heals is None


def _killed(server: HarmedServer) -> None:
    server.process.send_signal(signal.SIGKILL)


def _stopped(server: HarmedServer) -> None:
    server.process.send_signal(signal.SIGSTOP)


def _goes_on(server: HarmedServer) -> None:
    server.process.send_signal(signal.SIGCONT)


def _cut(server: HarmedServer) -> None:
    server.relay.cut()


def _half_open(server: HarmedServer) -> None:
    server.relay.swallows = True


def _slow(server: HarmedServer) -> None:
    server.relay.bytes_a_second = 1e6


def _delayed(server: HarmedServer) -> None:
    server.relay.delay = 0.2


def _lossy(server: HarmedServer) -> None:
    server.relay.loss = 0.05


def _relay_healed(server: HarmedServer) -> None:
    server.relay.heal()


FAULTS = (
    Fault("killed (kill -9)", _killed),
    Fault("frozen for good (SIGSTOP)", _stopped, silent=True),
    Fault("stopped for 0.7 s (SIGSTOP, SIGCONT)", _stopped, _goes_on, 0.7),
    Fault("connection cut", _cut),
    Fault("half-open connection (all is swallowed)", _half_open, silent=True),
    Fault("connection of 1 MB/s for 2 s", _slow, _relay_healed, 2.0),
    Fault("200 ms of delay for 2 s", _delayed, _relay_healed, 2.0),
    Fault("5 % of the segments lost for 2 s", _lossy, _relay_healed, 2.0),
)
