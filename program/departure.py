"""How a server leaves on SIGTERM: its client has others take over, and lets it go; without a client it ends at once."""

import logging
import os
import select
import signal
import threading
from contextlib import suppress
from types import FrameType

from volsplat.program.exit_status import EXIT_TERMINATED
from volsplat.protocol.messages.session_messages import LeaveSession
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection

LEAVE_SECONDS = 25.0  # for the client: engines give 30 between SIGTERM and SIGKILL

log = logging.getLogger(__name__)


class Departure:
    """Begins with the first SIGTERM; a second one ends the process at once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards what follows
        self._client: Connection | None = None
        self._begun = False

    @property
    def begun(self) -> bool:
        """Whether the server looks for no other client."""
        return self._begun

    def watch(self) -> None:
        """Take SIGTERM from now on, though the main thread may be in a kernel. For the main thread."""
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        signal.signal(signal.SIGTERM, self._end_if_idle)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        threading.Thread(target=self._follow, args=(reader,), name="leave on SIGTERM", daemon=True).start()

    def attend(self, client: Connection | None) -> None:
        """The server has this client from now on, or none."""
        with self._lock:
            self._client, begun = client, self._begun
        if begun and client is not None:
            self._say_so(client)

    def _end_if_idle(self, _signal: int, _frame: FrameType | None) -> None:
        if self._client is None:
            raise SystemExit(0)

    def _follow(self, signals: int) -> None:
        _wait_for_sigterm(signals)
        with self._lock:
            self._begun, client = True, self._client
        if client is not None and client.hung_up:  # who would have others take over is gone
            os._exit(EXIT_TERMINATED)
        if client is not None:
            log.warning("told to end; the client has up to %g s to have others take over", LEAVE_SECONDS)
            threading.Thread(target=self._say_so, args=(client,), name="tell the client", daemon=True).start()
        if not select.select([signals], [], [], LEAVE_SECONDS)[0]:
            log.warning("the client did not let this server go within %g s", LEAVE_SECONDS)
            os._exit(0)
        _wait_for_sigterm(signals)
        os._exit(EXIT_TERMINATED)

    @staticmethod
    def _say_so(client: Connection) -> None:
        with suppress(VolsplatError):  # who receives from it tells that it is lost
            client.send(LeaveSession())


def _wait_for_sigterm(signals: int) -> None:
    while os.read(signals, 1)[0] != signal.SIGTERM:
        pass
