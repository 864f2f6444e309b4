"""Imports that take long, done while a program waits for other things."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module


@contextmanager
def imported_ahead(*modules: str) -> Iterator[None]:
    """Import these modules on a thread meanwhile; who imports one within the block waits until it is there.

    At the end of the block what has not begun is left out. An import under way is awaited: a thread that is still
    within a library's C++ when Python ends can take the program down.
    """
    ended = threading.Event()

    def work() -> None:
        for module in modules:
            if ended.is_set():
                return
            try:
                import_module(module)
            except ImportError:
                return  # who needs it imports it again, and is told

    thread = threading.Thread(target=work, name="import ahead")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
