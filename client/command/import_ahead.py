"""Imports that take long, done while a program waits for other things."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import NoReturn

_THREAD = "import ahead"


@contextmanager
def imported_ahead(*modules: str) -> Iterator[Callable[[str], None]]:
    """Import these modules on a thread meanwhile; who imports one within the block waits until it is there.

    Gives what waits for one of them and all before it, and raises what importing them raised: of a library that has
    failed to load, a second import says nothing that helps.
    At the end of the block what has not begun is left out, and an import under way is awaited, except where an error
    or a signal ends the block: then the program must end by `leave`.
    """
    ended = threading.Event()
    there = {module: threading.Event() for module in modules}
    failed: list[Exception] = []

    def work() -> None:
        try:
            for module in modules:
                if ended.is_set():
                    return
                import_module(module)
                there[module].set()
        except Exception as error:  # a broken library raises anything
            failed.append(error)
        finally:
            for event in there.values():
                event.set()

    def awaited(module: str) -> None:
        there[module].wait()
        if failed:
            raise failed[0]

    thread = threading.Thread(target=work, name=_THREAD, daemon=True)
    thread.start()
    try:
        yield awaited
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
