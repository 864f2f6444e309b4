"""Where a program listens: host and port, and how a person writes them."""

from typing import NamedTuple

from volsplat.protocol.text.errors import BadInput

LOOPBACK = "127.0.0.1"
EVERYWHERE = "0.0.0.0"  # every address of this machine


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
