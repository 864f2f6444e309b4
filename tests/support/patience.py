"""How long a test waits for what must come: far longer than it takes, on a machine with ever so much else to do."""

import time
from collections.abc import Callable

PATIENCE = 120.0  # seconds, after which what never comes fails its test


def wait_until(holds: Callable[[], object], what: str) -> None:
    """Look again and again, for a small part of the time. Fails the test if it never holds, in the words of `what`."""
    deadline = time.monotonic() + PATIENCE
    while True:
        began = time.thread_time()
        if holds():
            return
        assert time.monotonic() < deadline, f"never {what}"
        time.sleep(max(0.01, 4 * (time.thread_time() - began)))
