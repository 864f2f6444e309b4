"""Locks of open files, each of which could be had at once or not."""

import fcntl

EXCLUSIVE, SHARED = fcntl.LOCK_EX, fcntl.LOCK_SH


def taken(descriptor: int, lock: int) -> bool:
    """Whether it could be had. Raises OSError, as for homes that other machines serve, without locks."""
    try:
        fcntl.flock(descriptor, lock | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def give_back(descriptor: int) -> None:
    """Also where a process that was forked from this one holds the file open as well."""
    fcntl.flock(descriptor, fcntl.LOCK_UN)
