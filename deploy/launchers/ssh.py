"""The launcher `ssh`: OpenSSH itself, with the user's own config, keys and jump hosts."""

import atexit
import random
import re
import shlex
import signal
import subprocess
import time
from functools import partial
from pathlib import Path

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.shell import ShellServers
from volsplat.deploy.process_group import end_group
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import one_line

SSH_SECONDS = 60.0  # for one script
CONNECT_SECONDS = 10
# Nobody is there to be asked. A connection that others share would stay, and keep what it has written to open, so that
# whoever reads that waits for ever; one that is there is used.
BATCH = ("-o", "BatchMode=yes", "-o", f"ConnectTimeout={CONNECT_SECONDS}", "-o", "ControlMaster=no")
_BEGUN = "volsplat-begins"
_BEGINS = f"printf '\\n{_BEGUN}\\n'; printf '\\n{_BEGUN}\\n' >&2\n"  # on a line of its own, whatever stands before
NOT_REACHED = 255  # ssh's own status
# What ssh says, alone, of an sshd that hangs up before anybody has logged in: one that many dial at once, as all
# machines of a cluster do by one jump host, turns some away at random (MaxStartups).
TURNED_AWAY = "kex_exchange_identification"
# What it says as well if a jump host is not reached, or lets nobody in: that is no chance.
FOR_GOOD = re.compile(
    "Permission denied|verification failed|Could not resolve|Connection refused|timed out|unreachable|No route"
)
TRIES = 5
FIRST_PAUSE_SECONDS = 1.0  # at most; twice as long after each try, and never the same for two machines
_LEFT_AT_EXIT = set["subprocess.Popen[str]"]()
NO_SSH = "ssh is not installed here; install OpenSSH's client"


def ssh_launcher(machine: Machine, folder: Path) -> ShellServers:
    """Its servers are detached: they outlive the connection, and write a log there."""
    assert machine.host is not None
    run, ask = partial(run_there, machine), partial(run_there, machine, may_be_left=True)
    return ShellServers(run, ask, machine.host, folder.name, lambda program: f"{machine.command} {program.command}")


def ssh_command(machine: Machine, script: str, *options: str) -> list[str]:
    """Has a POSIX shell there run this script; `options` are ssh's own, and come before the user's."""
    assert machine.host is not None
    return ["ssh", *BATCH, *options, *machine.ssh.options, "--", machine.host, _for_any_shell(script)]


def by_hand(machine: Machine) -> str:
    """What a person types to get there as the cluster file does."""
    assert machine.host is not None
    return shlex.join(["ssh", *machine.ssh.options, machine.host])


def _for_any_shell(script: str) -> str:
    """What any login shell, csh and fish as well, hands to a POSIX one: their quotes agree on all but these."""
    escaped = re.sub(r"[\\\n'!]", lambda found: f"\\0{ord(found[0]):03o}", script)
    return f"""exec sh -c 'eval "$(printf %b "$1")"' sh '{escaped}'"""


def run_there(machine: Machine, script: str, given: str, may_be_left: bool = False) -> str:
    """What a script prints there, given its input. Raises BadInput with the reason.

    What `may_be_left` is ended at the end of this process: a machine that hangs would keep its ssh for ever.
    """
    host = machine.host
    ran = _tried(machine, f"{_BEGINS}{script}", given, may_be_left)
    if ran.returncode == NOT_REACHED:
        raise BadInput(f"{host}: {one_line(ran.stderr) or 'ssh failed without a word'}; try: {by_hand(machine)}")
    said = _after_greetings(ran.stdout)
    if ran.returncode:
        reason = one_line(said or _after_greetings(ran.stderr)) or f"its shell ended with {ran.returncode}"
        cure = '; give command = "/path/to/volsplat" in the cluster file' if ran.returncode == 3 else ""
        raise BadInput(f"{host}: {reason}{cure}")
    return said


def _tried(machine: Machine, script: str, given: str, may_be_left: bool) -> "subprocess.CompletedProcess[str]":
    """Again where ssh was turned away before the script began. Raises BadInput."""
    pause = FIRST_PAUSE_SECONDS
    for _ in range(TRIES - 1):
        ran = _ran(machine, script, given, may_be_left)
        if not _was_turned_away(ran):
            return ran
        time.sleep(random.uniform(pause / 2, pause))
        pause *= 2
    return _ran(machine, script, given, may_be_left)


def _was_turned_away(ran: "subprocess.CompletedProcess[str]") -> bool:
    """By chance, and before the script began."""
    began = _BEGUN in ran.stdout or _BEGUN in ran.stderr
    failed = ran.returncode == NOT_REACHED and not began
    return failed and TURNED_AWAY in ran.stderr and not FOR_GOOD.search(ran.stderr)


def _ran(machine: Machine, script: str, given: str, may_be_left: bool) -> "subprocess.CompletedProcess[str]":
    pipe = subprocess.PIPE
    command = ssh_command(machine, script)
    try:
        ssh = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, encoding="utf-8", errors="replace", start_new_session=True
        )
    except FileNotFoundError as error:
        raise BadInput(NO_SSH) from error
    with ssh:
        if may_be_left:
            _LEFT_AT_EXIT.add(ssh)
        try:
            said, complaints = ssh.communicate(given, timeout=SSH_SECONDS)
        except subprocess.TimeoutExpired as error:
            told = f"{machine.host}: ssh has not answered for {SSH_SECONDS:g} s; try: {by_hand(machine)}"
            raise BadInput(told) from error
        finally:
            _LEFT_AT_EXIT.discard(ssh)
            end_group(ssh, signal.SIGKILL)
    return subprocess.CompletedProcess(command, ssh.returncode, said, complaints)


@atexit.register
def _end_what_is_left() -> None:
    for ssh in list(_LEFT_AT_EXIT):
        end_group(ssh, signal.SIGKILL)


def _after_greetings(said: str) -> str:
    """Without what the login shell's start-up files have printed; all of it where the script was never run."""
    before, begun, script_said = said.partition(f"\n{_BEGUN}\n")
    return script_said if begun else before


def host_name(machine: Machine) -> str:
    """The name or address that ssh dials for this machine: its config may know the host by another one."""
    return ssh_config(machine)["hostname"]


def ssh_config(machine: Machine) -> dict[str, str]:
    """What ssh would do for this machine, by keyword in small letters. Raises BadInput."""
    assert machine.host is not None
    command = ["ssh", "-G", *machine.ssh.options, "--", machine.host]
    try:
        ran = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=CONNECT_SECONDS)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BadInput(f"{machine.host}: ssh cannot be asked for its address: {error}") from error
    pairs = [line.partition(" ") for line in ran.stdout.splitlines()]
    config = {keyword: value for keyword, _, value in reversed(pairs)}  # of several of a kind the first counts
    if ran.returncode or "hostname" not in config:
        raise BadInput(f"{machine.host}: {one_line(ran.stderr) or 'ssh does not know it'}; check the cluster file")
    return config
