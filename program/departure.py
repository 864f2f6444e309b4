"""How a server leaves on SIGTERM: its client has others take over, and lets it go.

It has LEAVE_SECONDS to complete its frame while the client is heard, which gives a sign of life about every half second
(see heartbeat). Without a client, or with one that is lost or silent, a server ends soon, whatever its main thread is
at: the client is gone or stopped, or a library holds its interpreter. It heals then, as after any loss.
"""

import logging
import os
import select
import signal
import threading
import time
from contextlib import suppress
from types import FrameType
from typing import NoReturn

from volsplat.program.exit_status import EXIT_TERMINATED
from volsplat.protocol.messages.session_messages import LeaveSession
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection

LEAVE_SECONDS = 25.0  # for the client: engines give 30 between SIGTERM and SIGKILL
LEAVING_SILENCE = 1.5  # seconds, of the client: about three signs of life are missing, and the server is gone within 2
LOOKS_IN_SILENCE = 6
WITHOUT_CLIENT = "%s; this server ends without it"
LOOKS_AGAIN = "%s; looking for a client again"

log = logging.getLogger(__name__)


class Departure:
    """Begins with the first SIGTERM; a second one ends the process at once."""

    def __init__(self) -> None:
        self._told = False  # by a signal that came while there was a client; the main thread's
        self._lock = threading.Lock()  # guards what follows
        self._client: Connection | None = None
        self._begun = False

    @property
    def begun(self) -> bool:
        """Whether the server looks for no other client."""
        return self._told or self._begun  # whichever thread hears of it first

    def watch(self) -> None:
        """Take SIGTERM from now on, though the main thread may be in a kernel. For the main thread."""
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        signal.signal(signal.SIGTERM, self._begin)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        threading.Thread(target=self._follow, args=(reader,), name="leave on SIGTERM", daemon=True).start()

    def attend(self, client: Connection | None) -> None:
        """The server has this client from now on, or none."""
        with self._lock:
            self._client, begun = client, self._begun
        if begun and client is not None:
            _say_so(client)

    def tell_breach(self, lost: Exception) -> None:
        """The client broke the protocol. Ends this server if it was told to end. For the main thread."""
        with self._lock:  # who follows SIGTERM tells it, or finds it told
            begun = self.begun
            log.warning(WITHOUT_CLIENT if begun else LOOKS_AGAIN, lost)
            self._client = None
        if begun:
            raise SystemExit(EXIT_TERMINATED)

    def _begin(self, _signal: int, _frame: FrameType | None) -> None:
        if self._client is None:
            raise SystemExit(0)
        self._told = True

    def _follow(self, signals: int) -> None:
        _wait_for_sigterm(signals)
        with self._lock:
            self._begun, client = True, self._client
            if client is not None:
                _end_if_gone(client)
        if client is not None:
            log.warning(
                "told to end; while the client is heard, it has up to %g s to have others take over", LEAVE_SECONDS
            )
            _say_so(client)
        self._end_in_time(signals)

    def _end_in_time(self, signals: int) -> None:
        """The main thread ends the process first, unless it is at something that takes too long."""
        end = time.monotonic() + LEAVE_SECONDS
        came, quiet = None, 0  # looks, so that only time counts in which this process was awake
        while (left := end - time.monotonic()) > 0.0:
            if _sigterm_comes(signals, min(left, LEAVING_SILENCE / LOOKS_IN_SILENCE)):
                os._exit(EXIT_TERMINATED)
            client, before = self._client, came
            if client is not None:
                came = client, client.came
                heard = came != before or (client.unread and not client.hung_up)  # its end is to be read for ever
                quiet = 0 if heard else quiet + 1
                if quiet == LOOKS_IN_SILENCE:
                    self._end_without(client)
        log.warning("the client did not let this server go within %g s", LEAVE_SECONDS)
        os._exit(0)

    def _end_without(self, client: Connection) -> None:
        with self._lock:
            if self._client is not client:  # the main thread has told why, and ends
                return
            if client.closed and not client.loss:  # it has let this server go
                os._exit(0)
            silent = f"{client} has said nothing for {LEAVING_SILENCE:g} s: it is frozen, overloaded or cut off"
            _end_for(client.loss or silent)


def _end_if_gone(client: Connection) -> None:
    """End without one that cannot have others take over any more."""
    gone = client.loss or client.hung_up
    if client.broken:
        _end_for(client.loss)
    if gone:
        os._exit(EXIT_TERMINATED)


def _say_so(client: Connection) -> None:
    """Waits for nothing: a client that is frozen may not take what is said to it."""

    def say() -> None:
        with suppress(VolsplatError):  # who receives from it tells that it is lost
            client.send(LeaveSession())

    threading.Thread(target=say, name="tell the client", daemon=True).start()


def _end_for(loss: str) -> NoReturn:
    log.warning(WITHOUT_CLIENT, loss)
    os._exit(EXIT_TERMINATED)


def _sigterm_comes(signals: int, within: float) -> bool:
    """Whether it does in so many seconds; another signal ends the wait."""
    return bool(select.select([signals], [], [], within)[0]) and os.read(signals, 1)[0] == signal.SIGTERM


def _wait_for_sigterm(signals: int) -> None:
    while os.read(signals, 1)[0] != signal.SIGTERM:
        pass
