"""How long a test waits for what must come: far longer than it takes, on a machine with ever so much else to do."""

import time
from collections.abc import Callable

PATIENCE = 120.0  # seconds, after which what never comes fails its test


def wait_until(holds: Callable[[], object], what: str) -> None:
    """Look again and again. Fails the test if it never holds, in the words of `what`."""
    deadline = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < deadline, f"never {what}"
        time.sleep(0.01)
