"""How a process that has ended is told of."""

import os
import subprocess
import sys
import threading

import pytest

from volsplat.deploy.local import LocalServers
from volsplat.deploy.process_end import WITH_ITS_STARTER, told_end
from volsplat.deploy.server_command import Program
from volsplat.protocol.wire.tokens import new_token


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


def test_a_server_that_ends_with_its_starter_is_not_said_to_be_killed_for_want_of_memory() -> None:
    assert told_end(WITH_ITS_STARTER) == "was ended, since the process that starts servers had ended"


def test_a_start_that_is_interrupted_leaves_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    start = threading.Thread.start

    def interrupted(thread: threading.Thread) -> None:
        if thread.name.startswith("watch"):
            raise KeyboardInterrupt
        start(thread)

    servers = LocalServers(on_end=lambda line, name, replaced: None)
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            servers.start(Program.SPLAT_SERVER, "127.0.0.1:9", new_token(), threads=1)
    (process,) = servers.process_ids
    servers.stop()
    assert servers.process_ids == []
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
