"""Ctrl-C and other ending signals, at a moment when the exception that they raise could be lost."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LONGEST_IMPORT_SECONDS = 1.0  # that a person who wants the program to end may have to wait

_at_abrupt_end: list[Callable[[], None]] = []
_of_a_command = threading.Event()


def process_is_a_commands() -> None:
    """It may be ended at once, which would take from a script, or a notebook, all that it has computed."""
    _of_a_command.set()


def at_abrupt_end(act: Callable[[], None]) -> None:
    """Have `act` done if the process ends at once, which leaves no block by an exception. It must not wait."""
    _at_abrupt_end.append(act)


@contextmanager
def interrupts_held(on_signal: Callable[[], None] | None = None) -> Iterator[None]:
    """Ctrl-C and its like within wait for the end of the block, and are raised there.

    Without `on_signal` the block imports large libraries: what a module catches while it loads can be a
    KeyboardInterrupt. If that goes on for LONGEST_IMPORT_SECONDS a command's process ends at once; its servers notice.
    With it, it is called when a signal comes, and the block ends soon.
    """
    before = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    held = {number: handler for number, handler in before.items() if callable(handler)}
    if threading.current_thread() is not threading.main_thread() or not held:
        yield  # it is not raised here, or ends the process without a word
        return
    came: list[tuple[int, FrameType | None]] = []
    ended = threading.Event()

    def hold(number: int, frame: FrameType | None) -> None:
        came.append((number, frame))
        if on_signal is not None:
            on_signal()
        elif len(came) == 1 and _of_a_command.is_set():
            threading.Thread(target=_end_unless, args=(ended, number), name="end", daemon=True).start()

    for number in held:
        signal.signal(number, hold)
    try:
        yield
    finally:
        ended.set()
        for number, handler in held.items():
            signal.signal(number, handler)
        if came:
            first, frame = came[0]
            handler = held[signal.Signals(first)]
            assert callable(handler)
            handler(first, frame)


def _end_unless(ended: threading.Event, number: int) -> None:
    if not ended.wait(LONGEST_IMPORT_SECONDS):
        if number == signal.SIGINT:
            print("volsplat: interrupted", file=sys.stderr, flush=True)
        for act in _at_abrupt_end:
            act()
        os._exit(128 + number)
