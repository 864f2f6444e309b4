"""A network of the calling thread's own (Linux, root), which no other program of the machine sees.

Interfaces that come and go in the machine's own network would be everybody's business: a browser drops what it loads.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager

from volsplat.protocol.text.errors import BadInput

_CLONE_NEWNET = 0x40000000  # of <sched.h>; Python has setns() and unshare() from 3.12 on
_libc = ctypes.CDLL(None, use_errno=True)


@contextmanager
def own_network() -> Iterator[None]:
    """For this thread, and for threads and programs that it starts meanwhile. Raises BadInput if there can be none."""
    with open("/proc/thread-self/ns/net", "rb") as outside:
        _succeed(_libc.unshare(_CLONE_NEWNET), "unshare")
        try:
            yield
        finally:
            _succeed(_libc.setns(outside.fileno(), _CLONE_NEWNET), "setns")


def _succeed(status: int, what: str) -> None:
    if status:
        raise BadInput(f"a network of its own cannot be made: {what}: {os.strerror(ctypes.get_errno())}")
