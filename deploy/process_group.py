"""A program in a session of its own, which Ctrl-C on the terminal does not reach, and whose children end with it."""

import os
import signal
import subprocess
from contextlib import suppress


def end_group(process: "subprocess.Popen[str]", number: signal.Signals = signal.SIGTERM) -> None:
    """Signal it and what it has started, as ssh starts the way by a jump host. Does nothing once it has ended."""
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, number)
