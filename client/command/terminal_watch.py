"""Notices that whoever reads the program's output has gone: an ssh that was ended, a terminal's other half.

A terminal says so by SIGHUP. Without one (`ssh machine volsplat view ...` asks for none) no signal comes: the pipes
that the output goes to are closed, and that is all.
"""

from __future__ import annotations

import os
import select
import signal
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_OUTPUTS = (1, 2)
_LOOK_MILLISECONDS = 500  # between looks at whether there is still anything to watch for


@contextmanager
def ended_with_its_reader() -> Iterator[None]:
    """Send this process SIGHUP once a pipe or socket that its output goes to is closed at the other end.

    A person who has SIGHUP ignored (nohup) wants it to go on.
    """
    watched = [output for output in _OUTPUTS if _is_pipe(output)]
    if not watched or signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        yield
        return
    over = threading.Event()
    thread = threading.Thread(target=_watch, args=(watched, over), name="watch the reader", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()


def _watch(outputs: list[int], over: threading.Event) -> None:
    polling = select.poll()
    for output in outputs:
        polling.register(output, 0)  # that it hangs up is always reported
    while not over.is_set():
        if polling.poll(_LOOK_MILLISECONDS):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            for output in outputs:
                os.dup2(nowhere, output)  # last words must not fail
            os.kill(os.getpid(), signal.SIGHUP)
            return


def _is_pipe(output: int) -> bool:
    try:
        mode = os.fstat(output).st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)
