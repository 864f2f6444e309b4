"""The way into a machine by ssh: its name, its port, its shell, the volsplat there and the clock."""

import socket
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import version

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.launchers.shell import command_check
from volsplat.deploy.launchers.ssh import run_there, ssh_config
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.text.printable import one_line
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.dialling import dialled_socket

CLOCK_SECONDS = 2.0  # of difference, from which on log lines of two machines cannot be set side by side


def way_in(machine: Machine) -> list[Finding]:
    """What is found on it, up to the first hop that is wrong. By other launchers than ssh there is none."""
    if machine.launcher != "ssh":
        return []
    found: list[Finding] = []
    for finding in _hops(machine):
        found.append(finding)
        if not finding.right and finding.hop in ("name", "port", "ssh"):
            break
    return found


def _hops(machine: Machine) -> Iterator[Finding]:
    assert machine.host is not None
    try:
        config = ssh_config(machine)
    except BadInput as error:
        yield Finding(machine.host, "name", right=False, line=str(error))
        return
    yield from _by_proxy(machine.host, config) or _directly(machine.host, config)
    yield from _inside(machine, machine.host)


def _by_proxy(host: str, config: Mapping[str, str]) -> list[Finding]:
    """Where ssh goes by another machine this one may see neither name nor port."""
    proxies = [config[key] for key in ("proxyjump", "proxycommand") if config.get(key, "none") != "none"]
    return [Finding(host, "name", right=True, line=f"ssh finds it by way of {proxy}") for proxy in proxies]


def _directly(host: str, config: Mapping[str, str]) -> Iterator[Finding]:
    name, port = config["hostname"], int(config.get("port", 22))
    try:
        address = socket.getaddrinfo(name, port, type=socket.SOCK_STREAM)[0][4][0]
    except socket.gaierror as error:
        cure = "check host in the cluster file, or give HostName in ~/.ssh/config"
        yield Finding(host, "name", right=False, line=f"{name} is unknown ({error.strerror}); {cure}")
        return
    yield Finding(host, "name", right=True, line=f"{name} is {address}")
    try:
        dialled_socket(Address(name, port), f"sshd at {name}:{port}").close()
    except VolsplatError as error:
        yield Finding(host, "port", right=False, line=str(error))
        return
    yield Finding(host, "port", right=True, line=f"{port} answers")


def _inside(machine: Machine, host: str) -> Iterator[Finding]:
    script = f"{command_check(machine.command)}date +%s.%N\n{machine.command} --version 2>&1\n"
    before = time.time()
    try:
        said = run_there(machine, script, "").splitlines()
    except BadInput as error:
        yield Finding(host, "ssh", right=False, line=str(error).removeprefix(f"{host}: "))
        return
    yield Finding(host, "ssh", right=True, line="lets this user in without asking")
    yield _clock(host, said[0], before, time.time())
    yield _version(host, one_line(" ".join(said[1:])))


def _clock(host: str, said: str, before: float, after: float) -> Finding:
    """It was read there between two moments here."""
    try:
        there = float(said)
    except ValueError:
        return Finding(host, "clock", right=False, line=f"date answers {said!r}; volsplat needs GNU's or busybox's")
    off = there - before if there < before else max(0.0, there - after)
    if abs(off) < CLOCK_SECONDS:
        return Finding(host, "clock", right=True, line=f"no further from this machine's than {CLOCK_SECONDS:g} s")
    way = "behind" if off < 0 else "ahead of"
    return Finding(
        host, "clock", right=False, line=f"{abs(off):.3g} s {way} this machine's; have both keep time by NTP"
    )


def _version(host: str, said: str) -> Finding:
    here = version("volsplat")
    if said.split()[-1:] == [here]:
        return Finding(host, "version", right=True, line=f"volsplat {here}, as here")
    return Finding(
        host, "version", right=False, line=f"{said or 'nothing'} there, volsplat {here} here; install the same on both"
    )
