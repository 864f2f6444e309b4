"""The processes of a session's servers, to be harmed."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import psutil

from support.patience import wait_until
from volsplat.client import Session


def servers(session: Session, program: str) -> list[psutil.Process]:
    found = []
    for pid in session.server_processes:
        with suppress(psutil.NoSuchProcess):  # it has just ended
            if is_server(process := psutil.Process(pid), program):
                found.append(process)
    return found


def words_of(process: psutil.Process) -> list[str]:
    """Its command line, empty once it has ended, whether or not somebody still waits for it."""
    with suppress(psutil.NoSuchProcess):
        return process.cmdline()
    return []


def is_server(process: psutil.Process, program: str) -> bool:
    """Whether a process is a server of this program that runs: forked ones have its name, others it in their command.

    It may end meanwhile, and one that nobody has waited for yet has ended.
    """
    with suppress(psutil.NoSuchProcess):
        named = process.name() == program.replace("_", "-") or f"volsplat.{program}" in process.cmdline()
        return named and process.status() != psutil.STATUS_ZOMBIE
    return False


@contextmanager
def frozen(process: psutil.Process) -> Iterator[None]:
    process.suspend()
    wait_until(lambda: process.status() == psutil.STATUS_STOPPED, "does it stop")
    try:
        yield
    finally:
        with suppress(psutil.NoSuchProcess):  # it was ended, since another one was started
            process.send_signal(signal.SIGCONT)
