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
        return self._with(self.admission.token)

    def url_for_once(self, on_use: Callable[[], None]) -> str:
        """An address that opens the page one time; `on_use` is called then."""
        return self._with(self.admission.token_for_once(on_use))

    def _with(self, token: str) -> str:
        return f"http://{LOOPBACK}:{self.port}/?{TOKEN_PARAMETER}={token}"
