"""Servers as processes of this machine, each behind a relay of its own, that can be harmed and replaced."""

import subprocess
import sys
from itertools import count

import psutil
from faults.relay import Relay

from volsplat.client import Session
from volsplat.deploy.server_command import Program
from volsplat.protocol.wire.tokens import Token

MODULES = {Program.MAPSHADE_SERVER: "volsplat.mapshade_server", Program.SPLAT_SERVER: "volsplat.splat_server"}


class HarmedServer:
    """One process, and its way to the client."""

    def __init__(self, program: Program, session: Session, token: Token, seed: int) -> None:
        self.program = program
        self.relay = Relay((session.address.host, session.address.port), seed)
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULES[program], "--connect", self.relay.address, "--threads", "1"],
            env=token.added_to({}),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.process = psutil.Process(self._process.pid)

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        self.relay.cut()


class ServersAtHand:
    """The servers of one session, kept as many as they were at first."""

    def __init__(self, session: Session, token: Token, workers: int, splat_servers: int, seed: int) -> None:
        self._session, self._token = session, token
        self._seeds = count(seed)
        self.living: list[HarmedServer] = []
        for program, many in ((Program.SPLAT_SERVER, splat_servers), (Program.MAPSHADE_SERVER, workers)):
            for _ in range(many):
                self.start(program)

    def start(self, program: Program) -> None:
        self.living.append(HarmedServer(program, self._session, self._token, next(self._seeds)))

    def replace(self, harmed: HarmedServer) -> None:
        """As a launcher does that has heard of its end."""
        self.living.remove(harmed)
        self.start(harmed.program)

    def joined(self) -> bool:
        """Whether all that live have joined."""
        return sum(not server.lost for server in self._session.servers) >= len(self.living)

    def close(self) -> None:
        for server in self.living:
            server.end()
