"""How a server leaves on SIGTERM: its client has others take over, and lets it go.

It has LEAVE_SECONDS to complete its frame while the client is heard, which gives a sign of life every half second or
more often (see heartbeat). Without a client, or with one that is silent, a server ends at once: the client is stopped,
or a library holds its interpreter. It heals then, as after any loss.
"""

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
from volsplat.protocol.wire.heartbeat import Heartbeat

LEAVE_SECONDS = 25.0  # for the client: engines give 30 between SIGTERM and SIGKILL
LEAVING_SILENCE = 1.5  # seconds, of the client: three signs of life are missing, and the server is gone within 2

log = logging.getLogger(__name__)


class Departure:
    """Begins with the first SIGTERM; a second one ends the process at once."""

    def __init__(self, silence: float) -> None:
        """`silence` is what the client is told of this server: see heartbeat."""
        self._silence = silence
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
            self._take_leave(client)

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
            log.warning(
                "told to end; while the client is heard, it has up to %g s to have others take over", LEAVE_SECONDS
            )
            self._take_leave(client)
        if not select.select([signals], [], [], LEAVE_SECONDS)[0]:
            log.warning("the client did not let this server go within %g s", LEAVE_SECONDS)
            os._exit(0)
        _wait_for_sigterm(signals)
        os._exit(EXIT_TERMINATED)

    def _take_leave(self, client: Connection) -> None:
        """Waits for nothing: a client that is frozen may not take what is said to it."""
        Heartbeat(self._silence).keep(client, lambda: LEAVING_SILENCE, _end_without)
        threading.Thread(target=_say_so, args=(client,), name="tell the client", daemon=True).start()


def _say_so(client: Connection) -> None:
    with suppress(VolsplatError):  # who receives from it tells that it is lost
        client.send(LeaveSession())


def _end_without(loss: str) -> None:
    """The client is silent; the main thread may be at work for it for long."""
    log.warning("%s; this server ends without it", loss)
    os._exit(EXIT_TERMINATED)


def _wait_for_sigterm(signals: int) -> None:
    while os.read(signals, 1)[0] != signal.SIGTERM:
        pass
