"""The TCP sockets of this machine and whose they are, if its system tells (Linux, in /proc/net)."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address
from pathlib import Path

ESTABLISHED = 1
LISTENING = 10

_TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_WORD = 8  # hexadecimal digits


@dataclass(frozen=True)
class TcpSocket:
    local: tuple[str, int]
    remote: tuple[str, int]
    state: int
    owner: int  # user id
    inode: int


def tcp_sockets(port: int | None = None) -> Iterator[TcpSocket]:
    """Every socket that can be seen, or those at one port of this machine, which takes half the time.

    None if the system does not tell. An IPv4 address in IPv6 is given as IPv4.
    """
    ends_in = "" if port is None else f":{port:04X}"
    for table in _TABLES:
        try:
            lines = table.read_text("ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            _, local, remote, state, _, _, _, owner, _, inode, *_ = line.split()
            if local.endswith(ends_in):
                yield TcpSocket(_address(local), _address(remote), int(state, 16), int(owner), int(inode))


def _address(text: str) -> tuple[str, int]:
    """From hexadecimal words in this machine's order of bytes, and the port."""
    host, _, port = text.partition(":")
    words = (host[start : start + _WORD] for start in range(0, len(host), _WORD))
    found = ip_address(b"".join(int(word, 16).to_bytes(4, sys.byteorder) for word in words))
    if isinstance(found, IPv6Address) and found.ipv4_mapped is not None:
        found = found.ipv4_mapped
    return str(found), int(port, 16)
