"""The launcher `local`: processes of this machine that outlive the command that starts them."""

import shlex
import subprocess
from pathlib import Path

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.shell import ShellServers
from volsplat.deploy.server_command import server_command
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import one_line

SHELL_SECONDS = 60.0  # for one script, on a busy machine


def local_launcher(machine: Machine, folder: Path) -> ShellServers:
    return ShellServers(_run, _run, "this machine", folder.name, lambda program: shlex.join(server_command(program)))


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
