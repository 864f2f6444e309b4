"""A small lab on one machine: hosts as network namespaces, joined by a bridge over links of one rate (Linux, root).

Processor and memory are shared; only the network is each host's own. The calling thread is a host as well, behind a
link of its own, so that what a client receives is as slow as what servers do; it sees the lab alone meanwhile.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from secrets import token_hex

from volsplat.bench.hosts.own_network import own_network
from volsplat.protocol.text.errors import BadInput

NETWORK = "10.213.0.{host}"
BRIDGE = "bridge"
BURST_SECONDS = 0.005  # of data that leaves at once: timers are no finer
QUEUED_SECONDS = 0.05  # of data that waits in the link, as in a switch
LEAST_BURST = 16 << 10  # bytes, some packets
CLIENT = 1  # the host that this thread is


@dataclass(frozen=True)
class Host:
    """A namespace; or, with none, this thread behind its own link."""

    address: str
    namespace: str | None
    interface: str  # there, where its link begins
    port: str  # of the bridge, where it ends

    @property
    def inside(self) -> list[str]:
        """What stands before a command that runs there."""
        return ["ip", "netns", "exec", self.namespace] if self.namespace else []

    def shape(self, bits_per_second: float) -> None:
        """Make its link so slow, in both directions."""
        burst = max(LEAST_BURST, round(bits_per_second / 8 * BURST_SECONDS))
        limits = ("rate", f"{bits_per_second:.0f}bit", "burst", f"{burst}b", "latency", f"{QUEUED_SECONDS * 1e3:.0f}ms")
        do("tc", "qdisc", "replace", "dev", self.port, "root", "tbf", *limits)
        do(*self.inside, "tc", "qdisc", "replace", "dev", self.interface, "root", "tbf", *limits)

    def start(self, command: Sequence[str], environment: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
        """A program there. Whoever starts it ends it."""
        return subprocess.Popen([*self.inside, *command], env=environment, stdin=subprocess.DEVNULL)

    def processes(self) -> list[int]:
        """The ids of those in its namespace."""
        assert self.namespace is not None, "this thread's own host is not told apart from its process"
        listed = _call("ip", "netns", "pids", self.namespace).stdout
        return [int(line) for line in listed.split()]


def why_no_lab() -> str:
    """Why this machine cannot hold such a lab; empty if it can."""
    if not shutil.which("ip") or not shutil.which("tc"):
        return "network namespaces need `ip` and `tc` (Debian: iproute2)"
    if os.geteuid() != 0:
        return "network namespaces need root"
    tried = _call("ip", "netns", "add", f"volsplat-try-{os.getpid()}")
    if tried.returncode:
        return f"network namespaces cannot be made here: {tried.stderr.strip()}"
    _call("ip", "netns", "delete", f"volsplat-try-{os.getpid()}")
    return ""


@contextmanager
def lab(hosts: int, bits_per_second: float) -> Iterator[list[Host]]:
    """So many hosts, the first of which is this thread. Raises BadInput where there can be none."""
    if why := why_no_lab():
        raise BadInput(why)
    with ExitStack() as undone:
        undone.enter_context(own_network())
        undone.callback(_call, "ip", "link", "delete", BRIDGE)
        do("ip", "link", "set", "lo", "up")
        do("ip", "link", "add", BRIDGE, "type", "bridge")
        # With ARP it would answer for this thread's own address, and what comes would pass by the link.
        do("ip", "link", "set", BRIDGE, "arp", "off", "up")
        yield [_host(undone, n, bits_per_second) for n in range(CLIENT, hosts + 1)]


def _host(undone: ExitStack, number: int, rate: float) -> Host:
    """One more host at the bridge; its link is as slow in both directions."""
    name, port, address = f"host{number}", f"port{number}", NETWORK.format(host=number)
    namespace = None if number == CLIENT else f"volsplat-{token_hex(4)}-{name}"
    inside: tuple[str, ...] = ()
    do("ip", "link", "add", name, "type", "veth", "peer", "name", port)
    undone.callback(_call, "ip", "link", "delete", port)
    if namespace is not None:
        do("ip", "netns", "add", namespace)
        undone.callback(_call, "ip", "netns", "delete", namespace)
        do("ip", "link", "set", name, "netns", namespace)
        inside = ("ip", "netns", "exec", namespace)
        do(*inside, "ip", "link", "set", "lo", "up")
    do("ip", "link", "set", port, "master", BRIDGE, "up")
    do(*inside, "ip", "address", "add", f"{address}/24", "dev", name)
    do(*inside, "ip", "link", "set", name, "up")
    host = Host(address, namespace, name, port)
    host.shape(rate)
    return host


def do(*command: str) -> str:
    """What it prints. Raises BadInput with the reason."""
    done = _call(*command)
    if done.returncode:
        raise BadInput(f"{' '.join(command)}: {done.stderr.strip()}")
    return done.stdout


def _call(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False)
