"""What the system refuses, wherever that shows: memory, libraries, files and folders; what it says, in one line."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from traceback import walk_tb

from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.text.want_of_threads import CURE, NO_THREAD, is_want_of_processes, is_want_of_threads

_FOR_WANT_OF_MEMORY = ("failed to map segment", "cannot allocate memory", NO_THREAD, "bad_alloc")
_SHARED_OBJECTS = (".so", ".dylib")
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # as for what is printed into a file
_NO_WAY_IN = (errno.EACCES, errno.EPERM, errno.ELOOP, errno.ENAMETOOLONG, errno.ENOTDIR, errno.EROFS)


def system_failure(error: BaseException) -> VolsplatError | None:
    """The cause and the cure, for a person; None if the error is not the system's."""
    line = load_failure(error)
    return place_failure(error) or (None if line is None else BadInput(line))


def place_failure(error: BaseException) -> VolsplatError | None:
    """The cause and the cure if a place is full, closed to this user or gone, else None."""
    if not isinstance(error, OSError):
        return None
    reason = os.strerror(error.errno or 0)
    if error.errno in _NO_SPACE:
        return VolsplatError(f"{error.filename or 'the output'} cannot be written: {reason}; write it elsewhere")
    if error.errno in _NO_WAY_IN and error.filename is not None:
        return BadInput(f"{error.filename}: cannot be reached ({reason}); check its name and its folder's permissions")
    if isinstance(error, FileNotFoundError) and error.filename is None and not _is_somewhere():
        return BadInput("the current folder is there no more; change to another one, as by cd ~")
    return None


def _is_somewhere() -> bool:
    """Whether the current folder is there."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


def load_failure(error: BaseException) -> str | None:
    """The cause and the cure if memory does not suffice or a library could not be loaded, else None."""
    for cause in _causes(error):
        said = str(cause).strip().partition("\n")[0]
        if is_want_of_threads(cause) or is_want_of_processes(cause):
            return CURE
        if isinstance(cause, MemoryError) or _for_want_of_memory(cause, said):
            for_what = " to load a library" if _while_importing(cause) else ""
            told = f" ({said})" if said else ""
            return f"not enough memory{for_what}{told}; free some, or raise the limit (`ulimit -v`)"
        if isinstance(cause, ImportError) and any(kind in said for kind in _SHARED_OBJECTS):
            return f"a library cannot be loaded ({said}); install volsplat anew"
    return None


def _while_importing(error: BaseException) -> bool:
    """Python leaves its own importing out of tracebacks, but not the modules that were being run for it."""
    modules = (frame for frame, _ in walk_tb(error.__traceback__) if frame.f_code.co_name == "<module>")
    return isinstance(error, ImportError) or any(frame.f_globals.get("__name__") != "__main__" for frame in modules)


def _for_want_of_memory(error: BaseException, said: str) -> bool:
    if isinstance(error, OSError) and error.errno == errno.ENOMEM:
        return True
    loading = isinstance(error, ImportError | OSError | RuntimeError)
    return loading and any(words in said.lower() for words in _FOR_WANT_OF_MEMORY)


def _causes(error: BaseException) -> Iterator[BaseException]:
    """The error, and what it came from."""
    seen: BaseException | None = error
    while seen is not None:
        yield seen
        seen = seen.__cause__ or seen.__context__
