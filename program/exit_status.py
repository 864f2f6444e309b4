"""The exit statuses of every volsplat program, and how one ends with its status without delay."""

import atexit
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from volsplat.protocol.text.errors import BadInput, VolsplatError

EXIT_FAILED = 1
EXIT_BAD_INPUT = 2  # a person must put it right
EXIT_INTERRUPTED = 130  # as a shell says it of SIGINT
EXIT_TERMINATED = 143  # and of SIGTERM


def status_of(error: VolsplatError) -> int:
    """Of a program that this error ends."""
    return EXIT_BAD_INPUT if isinstance(error, BadInput) else EXIT_FAILED


@contextmanager
def quick_end() -> Iterator[None]:
    """An exit from within leaves no module to be taken down, once threads and all that is registered within have ended.

    To take down what a server has loaded takes a tenth of a second: of what a fork server loaded, it first copies all.
    What was registered before is passed by. None of it saves anything: logging's lines have been written.
    """
    left: list[int] = []

    def end() -> None:
        for status in left:
            with suppress(OSError):  # if what was said gets nowhere, the usual end tells of it
                for stream in filter(None, (sys.stdout, sys.stderr)):
                    stream.flush()
                os._exit(status)

    atexit.register(end)  # which comes after what is registered from now on, and before the rest
    try:
        yield
    except SystemExit as leaving:
        if isinstance(leaving.code, int):
            left.append(leaving.code)
        raise
