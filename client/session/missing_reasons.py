"""Why servers of a cluster are not in the session: each reason is reported once, and known until they come."""

import threading
from collections.abc import Callable


class MissingReasons:
    """Any thread may call it."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._lock = threading.Lock()  # guards what follows
        self._reasons: dict[str, str] = {}  # by the server's name
        self._closed = False

    def note(self, name: str, line: str) -> None:
        with self._lock:
            is_new = self._reasons.get(name) != line and not self._closed
            self._reasons[name] = line
        if is_new:
            self._report(line)

    def forget(self, name: str) -> None:
        """It has come."""
        with self._lock:
            self._reasons.pop(name, None)

    def get(self, name: str) -> str:
        """Empty if none is known."""
        with self._lock:
            return self._reasons.get(name, "")

    def close(self) -> None:
        """The session ends: nothing is reported any more."""
        with self._lock:
            self._closed = True
