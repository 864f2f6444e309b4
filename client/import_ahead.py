"""Imports that take long, done while a program waits for other things."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import NoReturn

_THREAD = "import ahead"


@contextmanager
def imported_ahead(*modules: str) -> Iterator[None]:
    """Import these modules on a thread meanwhile; who imports one within the block waits until it is there.

    At the end of the block what has not begun is left out, and an import under way is awaited, except where an error
    or a signal ends the block: then the program must end by `leave`. What cannot be loaded is told to whoever needs
    it; within the block, an import that failed here fails there the same.
    """
    ended = threading.Event()

    def work() -> None:
        for module in modules:
            if ended.is_set():
                return
            try:
                import_module(module)
            except Exception:  # a broken library raises anything; who needs it imports it again, and is told
                return

    thread = threading.Thread(target=work, name=_THREAD, daemon=True)
    thread.start()
    try:
        yield
        ended.set()
        thread.join()
    finally:
        ended.set()


def leave(status: int) -> NoReturn:
    """End the program, at once where an import is under way: in a library's C++, a thread would not outlive Python."""
    if any(thread.name == _THREAD for thread in threading.enumerate()):
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError):
                stream.flush()
        os._exit(status)
    sys.exit(status)
