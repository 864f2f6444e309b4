"""Where a program listens: host and port, and how a person writes them."""

from ipaddress import ip_address
from typing import NamedTuple

from volsplat.protocol.text.errors import BadInput

LOOPBACK = "127.0.0.1"
EVERYWHERE = "0.0.0.0"  # every address of this machine, of IPv4
EVERYWHERE_6 = "::"  # and of IPv6 as well


class Address(NamedTuple):
    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse_address(text: str) -> Address:
    """The address in "HOST:PORT", "[IPv6]:PORT" or ":PORT" (this machine alone). Raises BadInput."""
    host, colon, port = text.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    if not colon or not (port.isascii() and port.isdigit()) or int(port) > 65535 or (":" in host and not bracketed):
        raise BadInput(f"{text!r} is not an address; write HOST:PORT, such as {LOOPBACK}:7000 or [::1]:7000")
    return Address((host[1:-1] if bracketed else host) or LOOPBACK, int(port))


def plain_host(host: str) -> str:
    """An address of IPv4 as such, as one that has come to a port of IPv6 is told as one of these."""
    mapped = getattr(ip_address(host.partition("%")[0]), "ipv4_mapped", None)
    return host if mapped is None else str(mapped)


def everywhere(host: str) -> Address:
    """What a program listens at to be reached from other machines, of the same kind as the address `host`."""
    return Address(EVERYWHERE_6 if ":" in host else EVERYWHERE, 0)


def is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:  # a name
        return host == "localhost"


def reached_from(data: Address, anywhere: bool, worker: str, client: str) -> Address:
    """Where a worker reaches a splat server that the client sees at `data`.

    One that listens `anywhere` on the client's machine has no address of its own there: then a worker elsewhere, at
    the host `worker`, reaches it as it reaches the client, at the host `client`.
    """
    if anywhere and is_loopback(data.host) and not is_loopback(worker) and client:
        return data._replace(host=client)
    return data
