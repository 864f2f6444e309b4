"""The launcher `local`: processes of this machine that outlive the command that starts them."""

import shlex
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.launcher import Report, Said, Secrets, ServerOrder, StartedServer
from volsplat.deploy.launchers.shell import ShellServers
from volsplat.deploy.server_command import server_command
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import one_line

SHELL_SECONDS = 60.0  # for one script, on a busy machine


class LocalLauncher:
    def __init__(self, machine: Machine, folder: Path) -> None:
        self._servers = ShellServers(_run, _run, "this machine", folder.name)

    def start(self, orders: Sequence[ServerOrder], secrets: Secrets, report: Report) -> list[StartedServer]:
        report(f"starting {len(orders)} servers on this machine")
        return self._servers.start(orders, [shlex.join(server_command(order.program)) for order in orders], secrets)

    def states(self, servers: Sequence[StartedServer]) -> Mapping[str, Said]:
        return self._servers.states(servers)

    def stop(self, servers: Sequence[StartedServer], report: Report) -> None:
        self._servers.stop(servers)

    def logs(self, server: StartedServer, lines: int) -> str:
        return self._servers.logs(server, lines)


def _run(script: str, given: str) -> str:
    try:
        ran = subprocess.run(
            ["sh", "-c", script],
            input=given,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=SHELL_SECONDS,
            start_new_session=True,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BadInput(f"this machine: its shell does not answer: {error}") from error
    if ran.returncode:
        raise BadInput(
            f"this machine: {one_line(ran.stderr or ran.stdout) or f'its shell ended with {ran.returncode}'}"
        )
    return ran.stdout
