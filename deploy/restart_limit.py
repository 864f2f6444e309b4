"""How often a server that ends is started anew: one that cannot live is not started for ever."""

import time
from collections import deque

MOST_RESTARTS = 3  # in the place of one server, within …
RESTARTS_SECONDS = 60.0


class RestartLimit:
    """Of one server, whichever process is it now."""

    def __init__(self) -> None:
        self._when = deque[float](maxlen=MOST_RESTARTS)  # time.monotonic()

    def may_restart(self) -> bool:
        """Not too often; counts as one more if it may."""
        now = time.monotonic()
        if len(self._when) == MOST_RESTARTS and now - self._when[0] < RESTARTS_SECONDS:
            return False
        self._when.append(now)
        return True
