"""Where the page is, and what opens it."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import dataclass, field

from volsplat.client.ui.doors.admission import TOKEN_PARAMETER, Admission
from volsplat.protocol.wire.addresses import LOOPBACK


@dataclass(frozen=True)
class PageAddress:
    """A socket that is bound on this machine alone, and who is admitted there."""

    bound: socket.socket
    admission: Admission = field(default_factory=Admission)

    @property
    def port(self) -> int:
        port: int = self.bound.getsockname()[1]
        return port

    @property
    def url(self) -> str:
        """For the person's eyes: it opens the page as long as the session lasts."""
        behind = self.admission.behind
        return _with_token(self._here if behind is None else behind.url, self.admission.token)

    def url_for_once(self, on_use: Callable[[], None]) -> str:
        """An address that opens the page one time on this machine; `on_use` is called then."""
        return _with_token(self._here, self.admission.token_for_once(on_use))

    @property
    def _here(self) -> str:
        return f"http://{LOOPBACK}:{self.port}/"


def _with_token(url: str, token: str) -> str:
    return f"{url}?{TOKEN_PARAMETER}={token}"
