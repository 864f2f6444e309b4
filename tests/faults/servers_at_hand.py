"""Servers as processes of this machine, each behind a relay of its own, that can be harmed and replaced."""

import random
import sys
from collections.abc import Sequence
from itertools import count
from pathlib import Path

import psutil
from faults.kinds_of_fault import FAULTS, Fault
from faults.relay import Relay

from volsplat.client import Session
from volsplat.deploy.forked_servers import ForkedServers
from volsplat.deploy.server_command import Program
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS
from volsplat.protocol.wire.tokens import Token, new_token


class RelayedServer:
    """One process, and its way to the client."""

    def __init__(
        self, forks: ForkedServers, program: Program, session: Session, token: Token, seed: int, *options: str
    ) -> None:
        self.program = program
        self.network = Relay((session.address.host, session.address.port), seed)
        arguments = ("--connect", self.network.address, *options, "--threads", "1")
        self._process = forks.start(program, arguments, token.added_to({}))
        self.process = psutil.Process(self._process.pid)

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        self.network.cut()


class ServersAtHand:
    """The servers of one session, kept as many as they were at first."""

    faults: Sequence[Fault] = FAULTS
    most_losses = sys.maxsize  # of servers in one session

    def __init__(
        self,
        volume: Path,
        chance: random.Random,
        workers: int,
        splat_servers: int,
        silence: float = SILENCE_SECONDS,
    ) -> None:
        self._token, self._forks = new_token(), ForkedServers()  # which has another one there soon
        self.workers, self.splat_servers, self._silence = workers, splat_servers, silence
        self.session = Session(
            volume, workers=workers, splat_servers=splat_servers, spawn=False, token=self._token, silence=silence
        )
        self._seeds = count(chance.randrange(1 << 30))
        self.living: list[RelayedServer] = []
        self._replaced: list[RelayedServer] = []
        for program, many in ((Program.SPLAT_SERVER, splat_servers), (Program.MAPSHADE_SERVER, workers)):
            for _ in range(many):
                self._start(program)

    def replace(self, number: int) -> None:
        """As a launcher does that has heard of the end of one of the living."""
        harmed = self.living.pop(number)
        self._replaced.append(harmed)
        self._start(harmed.program)

    def joined(self) -> bool:
        """Whether all that live have joined, and none else is left."""
        while self._replaced:
            self._replaced.pop().end()
        return sum(not server.lost for server in self.session.servers) >= len(self.living)

    def close(self) -> None:
        self.session.close()
        for server in self.living + self._replaced:
            server.end()
        self._forks.end()

    def _start(self, program: Program) -> None:
        silence = ("--silence", str(self._silence))
        self.living.append(RelayedServer(self._forks, program, self.session, self._token, next(self._seeds), *silence))
