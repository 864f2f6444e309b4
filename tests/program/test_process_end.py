"""How a process that has ended is told of."""

import subprocess
import sys

import pytest

from volsplat.deploy.process_end import told_end


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ("sys.exit(0)", "ended by itself"),
        ("sys.exit(3)", "ended with status 3; its own output tells why"),
        ("os.kill(os.getpid(), 9)", "was killed by SIGKILL (by hand, or by the system for want of memory)"),
        ("os.kill(os.getpid(), signal.SIGBUS)", "was killed by SIGBUS (a file was cut short or a disk failed"),
        ("os.kill(os.getpid(), signal.SIGTERM)", "was killed by SIGTERM"),
    ],
)
def test_a_signal_is_named_and_a_status_points_to_the_output(ends: str, told: str) -> None:
    ended = subprocess.run([sys.executable, "-c", f"import os, signal, sys; {ends}"])
    assert told_end(ended.returncode).startswith(told)
