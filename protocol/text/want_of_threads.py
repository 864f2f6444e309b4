"""Want of threads: what Python says where the system gives a process no further one, and the cure."""

NO_THREAD = "can't start new thread"
CURE = f"not enough memory or processes ({NO_THREAD}); end some, or raise the limits (`ulimit -u`, `ulimit -v`)"


def is_want_of_threads(error: BaseException) -> bool:
    return isinstance(error, RuntimeError) and str(error).strip().partition("\n")[0] == NO_THREAD
