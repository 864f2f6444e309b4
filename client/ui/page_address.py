"""Where the page is, and what opens it."""

from __future__ import annotations

import secrets
import socket
from dataclasses import dataclass, field

from volsplat.protocol.addresses import LOOPBACK

TOKEN_PARAMETER = "token"
TOKEN_BYTES = 24


@dataclass(frozen=True)
class PageAddress:
    """A socket that is bound on this machine alone, and the token without which nothing is answered there."""

    bound: socket.socket
    token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))

    @property
    def port(self) -> int:
        port: int = self.bound.getsockname()[1]
        return port

    @property
    def url(self) -> str:
        return f"http://{LOOPBACK}:{self.port}/?{TOKEN_PARAMETER}={self.token}"
