"""Clusters of a test's own: files, and sshd on loopback with keys and a port of its own."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path

import msgspec
import psutil
import pytest

from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.programs import Person
from volsplat.deploy.cluster.orders import Ordered, orders_of, wanted_servers
from volsplat.deploy.cluster_file import Cluster

SSHD = shutil.which("sshd") or "/usr/sbin/sshd"


def cluster_file(folder: Path, name: str, *machines: str, keep: int = 600) -> Path:
    path = folder / "cluster.toml"
    tables = "\n".join(f"[[machines]]\n{machine}" for machine in machines)
    path.write_text(f'name = "{name}"\nkeep = {keep}\n{tables}\n', encoding="utf-8")
    return path


def ordered(cluster: Cluster, listen_port: int) -> list[Ordered]:
    """What `deploy up` orders for all machines."""
    by_machine = groupby(wanted_servers(cluster), lambda one: one.machine)
    return [one for _, servers in by_machine for one in orders_of(cluster, list(servers), listen_port)]


def handles(person: Person) -> list[dict[str, str]]:
    """By which the launcher of the only cluster that is up knows its servers."""
    (state,) = (person.folder / "state").glob("volsplat/clusters/*/state.json")
    return [one["started"]["handle"] for one in msgspec.json.decode(state.read_bytes())["servers"]]


def servers_of(person: Person) -> list[psutil.Process]:
    """Those that run here, with where this person's state lies."""
    return [one for one in psutil.process_iter() if _is_server_of(person, one)]


def _is_server_of(person: Person, process: psutil.Process) -> bool:
    try:
        there = process.environ().get("XDG_STATE_HOME") == str(person.folder / "state")
        named = any(word.endswith("_server") for word in process.cmdline())
        return there and named and process.status() != psutil.STATUS_ZOMBIE
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return False


def drawn(person: Person, *options: str) -> bytes:
    """The file that comes of head.nrrd."""
    image = person.folder / "image.png"
    image.unlink(missing_ok=True)
    ran = person.runs("render", "head.nrrd", "-o", str(image), "--size", "48x48", *options)
    assert ran.returncode == 0, ran.stderr
    return image.read_bytes()


@contextmanager
def sshd(folder: Path, *settings: str, address: str = "127.0.0.1") -> Iterator[str]:
    """A daemon that lets this user in; what a machine's table in a cluster file needs for it. `settings` are sshd's."""
    if not Path(SSHD).exists() or shutil.which("ssh") is None:
        pytest.skip("needs sshd and ssh (Debian: openssh-server, openssh-client)")
    folder.mkdir()
    for key in ("host_key", "user_key"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / key)], check=True)
    shutil.copy(folder / "user_key.pub", folder / "authorized_keys")
    port = free_port()
    config = folder / "sshd_config"
    config.write_text(
        f"Port {port}\nListenAddress {address}\nHostKey {folder}/host_key\nPidFile {folder}/pid\nUsePAM no\n"
        f"AuthorizedKeysFile {folder}/authorized_keys\nStrictModes no\nPasswordAuthentication no\n"
        + "".join(f"{line}\n" for line in (f"SetEnv XDG_STATE_HOME={folder}/state", *settings)),
        encoding="utf-8",
    )
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # where Debian's separates privileges
    log = folder / "log"
    daemon = subprocess.Popen([SSHD, "-D", "-E", str(log), "-f", str(config)])
    try:
        wait_until(lambda: daemon.poll() is not None or (folder / "pid").exists(), "listened")
        if daemon.poll() is not None:
            pytest.skip(f"sshd does not run here: {log.read_text(errors='replace')}")
        options = ["-p", str(port), "-i", f"{folder}/user_key", "-o", "StrictHostKeyChecking=no"]
        options += ["-o", f"UserKnownHostsFile={folder}/known_hosts", "-F", "none"]
        command = Path(sys.executable).parent / "volsplat"
        yield f'launcher = "ssh"\nhost = "{address}"\ncommand = "{command}"\nssh = {{options = {options!r}}}\n'
    finally:
        daemon.terminate()
        daemon.wait(PATIENCE)
