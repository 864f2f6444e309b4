"""Want of threads and processes: what Python says where the system gives no further one, and the cure."""

import errno
import os

NO_THREAD = "can't start new thread"
CURE = f"not enough memory or processes ({NO_THREAD}); end some, or raise the limits (`ulimit -u`, `ulimit -v`)"


def is_want_of_threads(error: BaseException) -> bool:
    return isinstance(error, RuntimeError) and str(error).strip().partition("\n")[0] == NO_THREAD


def is_want_of_processes(error: BaseException) -> bool:
    """In a program that waits for its files and sockets, and meets the system's word for `later` nowhere else."""
    return isinstance(error, BlockingIOError) and error.strerror == os.strerror(errno.EAGAIN)
