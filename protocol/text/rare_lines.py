"""Warnings about callers, who could cause any number of them: a few are said at once, then few a minute.

Those that are left out are counted, and the count is said.
"""

import logging
import threading
import time
from contextlib import suppress

MOST_AT_ONCE = 20  # lines
SECONDS_A_LINE = 5.0  # until one more may be said


class RareLines:
    """Any thread may warn."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._lock = threading.Lock()  # guards what follows
        self._may_say = float(MOST_AT_ONCE)
        self._counted_at = time.monotonic()
        self._left_out = 0
        self._timer: threading.Timer | None = None  # says what was left out, when a line may be said again
        self._closed = False

    def warn(self, line: str) -> None:
        with self._lock:
            if not self._may_say_one():
                self._left_out += 1
                self._say_later()
                return
        self._say_left_out()
        self._log.warning("%s", line)

    def close(self) -> None:
        """Say what was left out; nothing more is said by itself. May be called again."""
        with self._lock:
            self._closed = True
            timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
        self._say_left_out()

    def _may_say_one(self) -> bool:
        now = time.monotonic()
        self._may_say = min(MOST_AT_ONCE, self._may_say + (now - self._counted_at) / SECONDS_A_LINE)
        self._counted_at = now
        if self._may_say < 1.0:
            return False
        self._may_say -= 1.0
        return True

    def _say_later(self) -> None:
        if self._timer is None and not self._closed:
            timer = threading.Timer(SECONDS_A_LINE, self._its_time)
            timer.daemon = True
            with suppress(RuntimeError):  # the system has no thread left to give; the next line says it
                timer.start()
                self._timer = timer

    def _its_time(self) -> None:
        with self._lock:
            self._timer = None
            self._may_say_one()
        self._say_left_out()

    def _say_left_out(self) -> None:
        with self._lock:
            left_out, self._left_out = self._left_out, 0
        if left_out:
            self._log.warning("%d more lines of this kind were left out", left_out)
