"""The launcher `manual`: prints the line to type on each machine; people start and end those servers."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.launcher import Report, Said, Secrets, ServerOrder, ServerState, StartedServer
from volsplat.protocol.text.errors import BadInput

STARTED_BY_HAND = "started by hand; this machine cannot ask after it"


class ManualLauncher:
    def __init__(self, machine: Machine, folder: Path) -> None:
        self._machine = machine

    def start(self, orders: Sequence[ServerOrder], secrets: Secrets, report: Report) -> list[StartedServer]:
        where = self._machine.host or "the other machine"
        report(f"copy {secrets.token_file} to {where}, keep it from others' eyes (chmod 600), and type there:")
        for order in orders:
            words = [order.program.command, *order.arguments, "--token-file", secrets.token_file.name]
            report(f"{self._machine.command} {shlex.join(words)}")
        return [StartedServer(order.name, where, {}) for order in orders]

    def states(self, servers: Sequence[StartedServer]) -> Mapping[str, Said]:
        return {server.name: Said(ServerState.UNKNOWN, STARTED_BY_HAND) for server in servers}

    def stop(self, servers: Sequence[StartedServer], report: Report) -> None:
        """They end by themselves when no client has come for as long as they are to be kept."""
        where = self._machine.host or "the other machine"
        report(f"{len(servers)} servers go on: end them on {where}, by hand; without a client they end by themselves")

    def logs(self, server: StartedServer, lines: int) -> str:
        raise BadInput(f"{server.name} was started by hand: its output is on the terminal there")
