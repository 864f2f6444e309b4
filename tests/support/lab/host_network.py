"""What can befall the network of a host in a box, and be mended."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import psutil

from support.lab.delay_line import DelayLine
from volsplat.bench.hosts.namespaces import BRIDGE, Host, do

TABLE = "inet faults"  # of nftables, on the host that suffers
CHAINS = {"input": ("dport", "sport"), "output": ("sport", "dport")}  # how its own port and its peer's are called
EXCEPT_SSH = ("tcp dport 22 accept", "tcp sport 22 accept")


def why_unharmed() -> str:
    """Why a network cannot be harmed here so; empty if it can."""
    if not shutil.which("nft") or not shutil.which("ss"):
        return "harm to a network needs `nft` and `ss` (Debian: nftables, iproute2)"
    return "" if Path("/dev/net/tun").exists() else "harm to a network needs TAP devices (modprobe tun)"


class HostNetwork:
    """Of a process there, where it is about connections."""

    def __init__(self, host: Host, process: psutil.Process, rate: float) -> None:
        """`rate` in bits a second, that it has in health."""
        self._host, self._process, self._rate = host, process, rate
        self._slow: DelayLine | None = None

    def go_down(self) -> None:
        do("ip", "link", "set", self._host.port, "down")

    def cut(self) -> None:
        """Reset each connection of the process, at both ends."""
        for own, peer in self._ports():
            self._do("ss", "--kill", f"sport = :{own} and dport = :{peer}")

    def swallow(self) -> None:
        """Nothing passes any more on the connections that the process has; others can be made."""
        ports = self._ports()
        self._filter(
            {
                chain: [f"tcp {own_port} {own} tcp {peer_port} {peer} drop" for own, peer in ports]
                for chain, (own_port, peer_port) in CHAINS.items()
            }
        )

    def lose(self, part: float) -> None:
        """So much of the packets, in each direction."""
        self._filter(dict.fromkeys(CHAINS, [f"numgen random mod 1000 < {round(1000 * part)} drop"]))

    def swallow_large(self) -> None:
        """Packets of full size are lost without a word, but for those of ssh."""
        self._filter(dict.fromkeys(CHAINS, [*EXCEPT_SSH, "meta length > 1280 drop"]))

    def swallow_large_to(self, peer: Host) -> None:
        """As swallow_large, before they have left: the system takes them back, and has nothing under way."""
        self._filter({"output": [*EXCEPT_SSH, f"ip daddr {peer.address} meta length > 1280 drop"]})

    def swallow_large_from(self, peer: Host) -> None:
        """As swallow_large, once they have arrived: the peer's system sends them again."""
        self._filter({"input": [*EXCEPT_SSH, f"ip saddr {peer.address} meta length > 1280 drop"]})

    def slow_down(self, bytes_a_second: float) -> None:
        self._host.shape(8 * bytes_a_second)

    def delay(self, seconds: float) -> None:
        """Hold every packet back, in each direction."""
        here, there = f"near-{self._host.port}", f"far-{self._host.port}"
        address = self._do("cat", f"/sys/class/net/{self._host.interface}/address").strip()
        self._slow = DelayLine((here, there), seconds)
        do("ip", "link", "set", here, "master", BRIDGE, "up")
        do("ip", "link", "set", there, "netns", str(self._host.namespace))
        self._do("ip", "link", "set", there, "address", address)
        self._do("ip", "address", "add", f"{self._host.address}/24", "dev", there)
        self._do("ip", "link", "set", there, "up")
        self._do("ip", "link", "set", self._host.interface, "down")  # whose address stays, and its route goes

    def heal(self) -> None:
        """Undo all that lasts."""
        do("ip", "link", "set", self._host.port, "up")
        self._do("ip", "link", "set", self._host.interface, "up")
        if self._slow is not None:
            self._slow.close()
            self._slow = None
        self._do("nft", f"add table {TABLE}; delete table {TABLE}")  # there may be none
        self._host.shape(self._rate)

    def _filter(self, rules: dict[str, Sequence[str]]) -> None:
        for chain, told in rules.items():
            hook = f"type filter hook {chain} priority 0;"
            self._do("nft", "\n".join([f"table {TABLE} {{", f"chain {chain} {{", hook, *told, "}", "}"]))

    def _ports(self) -> list[tuple[str, str]]:
        """Its own and its peer's, of each connection: those of Unix sockets are not the network's."""
        lines = self._do("ss", "-Htnp", "state", "established").splitlines()
        ends = [line.split()[2:4] for line in lines if f"pid={self._process.pid}," in line]
        return [(own.rpartition(":")[2], peer.rpartition(":")[2]) for own, peer in ends]

    def _do(self, *command: str) -> str:
        return do(*self._host.inside, *command)
