"""Want of memory, and libraries that cannot be loaded, mostly because of it: what the system says, in one line."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from traceback import walk_tb

from volsplat.protocol.text.want_of_threads import CURE, NO_THREAD, is_want_of_processes, is_want_of_threads

_FOR_WANT_OF_MEMORY = ("failed to map segment", "cannot allocate memory", NO_THREAD, "bad_alloc")
_SHARED_OBJECTS = (".so", ".dylib")


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
