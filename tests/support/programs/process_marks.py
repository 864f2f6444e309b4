"""Marks of processes that were forked, and of all that they fork in turn.

Their environment does not tell them apart: the system shows the one that their common ancestor was started with.
"""

import os
from contextlib import suppress


def mark(text: str) -> None:
    """Mark this process, by memory that it holds."""
    os.memfd_create(text)


def is_marked(pid: int, text: str) -> bool:
    """Whether it is so marked; it may have ended."""
    with suppress(FileNotFoundError, ProcessLookupError):
        for descriptor in os.listdir(f"/proc/{pid}/fd"):
            with suppress(FileNotFoundError):
                if os.readlink(f"/proc/{pid}/fd/{descriptor}").startswith(f"/memfd:{text} "):
                    return True
    return False
