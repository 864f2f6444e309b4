"""A lab in a box: hosts as network namespaces behind links of 1 Gbit/s, each with an sshd that knows the test's key."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from support.patience import wait_until
from support.programs.programs import VOLSPLAT
from volsplat.bench.hosts.namespaces import Host, do, lab, why_no_lab
from volsplat.deploy.server_command import Program

GIGABIT = 1e9  # bits a second
NAMES = ("client", "splat", "worker-1", "worker-2", "worker-3")
SERVERS = {program.value for program in Program} | {"mapshade-server", "splat-server"}  # as words of a command
SSHD = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin")

_SSHD_CONFIG = """\
ListenAddress {address}
HostKey {host_key}
AuthorizedKeysFile {key}.pub
PidFile none
UsePAM no
StrictModes no
PermitRootLogin prohibit-password
PasswordAuthentication no
MaxStartups 100
LogLevel ERROR
Subsystem sftp internal-sftp
"""
_SSH_CONFIG = """\
Host {name}
  HostName {address}
  HostKeyAlias {name}
"""
_SSH_CONFIG_OF_ALL = """\
Host *
  User root
  IdentityFile {key}
  IdentitiesOnly yes
  UserKnownHostsFile {known_hosts}
  GlobalKnownHostsFile none
  StrictHostKeyChecking yes
  BatchMode yes
  LogLevel ERROR
"""


def why_no_box() -> str:
    """Why this machine cannot hold such a lab; empty if it can."""
    if SSHD is None or not shutil.which("ssh") or not shutil.which("ssh-keygen"):
        return "a lab in a box needs ssh and sshd (Debian: openssh-client, openssh-server)"
    return why_no_lab()


@dataclass(frozen=True)
class Box:
    """The hosts by name, without the test's own, and the configuration by which ssh reaches each."""

    own: Host  # this process, behind a link of its own
    hosts: dict[str, Host]
    daemons: dict[str, int]
    ssh_config: Path

    def ssh(self, name: str, command: Sequence[str], at: Host | None = None) -> subprocess.Popen[bytes]:
        """A command on the host of this name, by ssh from another: this process's unless one is named."""
        # A host's last word may be lost with its link; without asking, ssh would wait for ever then.
        words = ["ssh", "-F", str(self.ssh_config), "-o", "ServerAliveInterval=5", name, "exec", *command]
        return (at or self.own).start(words)

    def machine(self, name: str, servers: str) -> str:
        """What a cluster file says of a host that runs one server, map-shade-servers or splat-servers, by ssh."""
        return (
            f'[[machines]]\nlauncher = "ssh"\nhost = "{name}"\n{servers} = 1\nthreads = 1\n'
            f'command = "{VOLSPLAT}"\nssh.options = ["-F", "{self.ssh_config}"]\n'
        )

    def servers(self, name: str) -> list[int]:
        """The process ids of the servers that run on a host."""
        return [process for process in self.hosts[name].processes() if _is_server(process)]

    def let_only_ssh_through(self, name: str, jump: str | None = None) -> None:
        """A firewall on a host: of TCP from elsewhere nothing but what goes to or comes from port 22.

        With `jump` that host alone gets in, and ssh goes by it from now on.
        """
        callers = ""
        if jump is not None:
            callers = f"ip saddr {self.hosts[jump].address} "
            with self.ssh_config.open("a", encoding="utf-8") as config:
                config.write(f"Host {name}\n  ProxyJump {jump}\n")
        rules = ['iif "lo" accept', f"{callers}tcp dport 22 accept", "tcp sport 22 accept", "meta l4proto tcp drop"]
        chain = ["type filter hook input priority 0;", *rules]
        do(*self.hosts[name].inside, "nft", "\n".join(["table inet only_ssh {", "chain input {", *chain, "}", "}"]))

    def cut_link(self, name: str) -> None:
        do("ip", "link", "set", self.hosts[name].port, "down")

    def join_link(self, name: str) -> None:
        do("ip", "link", "set", self.hosts[name].port, "up")


@contextmanager
def box(folder: Path, names: Sequence[str] = NAMES) -> Iterator[Box]:
    """Hosts of these names. Nothing of them stays behind, whatever was started by ssh included."""
    key = _new_key(folder / "key")
    known_hosts = folder / "known_hosts"
    with ExitStack() as undone:
        own, *others = undone.enter_context(lab(1 + len(names), GIGABIT))
        hosts = dict(zip(names, others, strict=True))
        daemons = {}
        told = _SSH_CONFIG_OF_ALL.format(key=key, known_hosts=known_hosts)
        known = ""
        for name, host in hosts.items():
            host_key = _new_key(folder / f"{name}.key")
            known += f"{name} {host_key.with_suffix('.key.pub').read_text(encoding='utf-8')}"
            told += _SSH_CONFIG.format(name=name, address=host.address)
            config = folder / f"{name}.sshd"
            config.write_text(_SSHD_CONFIG.format(address=host.address, host_key=host_key, key=key), encoding="utf-8")
            daemons[name] = undone.enter_context(_daemon(host, config))
        known_hosts.write_text(known, encoding="utf-8")
        ssh_config = folder / "ssh_config"
        ssh_config.write_text(told, encoding="utf-8")
        yield Box(own, hosts, daemons, ssh_config)


def _new_key(path: Path) -> Path:
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "", "-f", str(path)], check=True)
    return path


@contextmanager
def _daemon(host: Host, config: Path) -> Iterator[int]:
    """A host's sshd, which listens."""
    Path("/run/sshd").mkdir(exist_ok=True)  # where sshd gives up its rights; systemd makes it elsewhere
    assert SSHD is not None
    daemon = host.start([SSHD, "-D", "-e", "-f", str(config)])
    try:
        wait_until(lambda: daemon.poll() is not None or _greets(host), "reached the host's sshd")
        assert daemon.poll() is None, "sshd ended; its errors stand above"
        yield daemon.pid
    finally:
        for process in host.processes():  # what was started through it is detached
            _kill(process)
        daemon.wait()


def _greets(host: Host) -> bool:
    try:
        with socket.create_connection((host.address, 22), timeout=1) as taken:
            return taken.recv(4) == b"SSH-"
    except OSError:
        return False


def _is_server(process: int) -> bool:
    try:
        return any(word in SERVERS for word in psutil.Process(process).cmdline())
    except psutil.NoSuchProcess:
        return False


def _kill(process: int) -> None:
    try:
        os.kill(process, signal.SIGKILL)
    except ProcessLookupError:
        return
