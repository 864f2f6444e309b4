"""What an array's own library raises, whatever that is, as one line for the script."""

from collections.abc import Iterator
from contextlib import contextmanager

from volsplat.protocol.text.errors import BadInput, VolsplatError


@contextmanager
def library_errors(what: str) -> Iterator[None]:
    """Raises BadInput for what goes wrong within, where the library of `what` is asked for numbers."""
    try:
        yield
    except VolsplatError:
        raise
    except MemoryError as error:
        raise BadInput(f"{what} does not fit into this machine's memory: {_told(error)}; choose a part of it") from None
    except (TypeError, NotImplementedError) as error:  # a sparse tensor; an array on a GPU, which says how to fetch it
        raise BadInput(f"{what} gives no numbers that could be drawn: {_told(error)}") from error
    except Exception as error:  # of the file that it is read from, of a function that computes it
        raise BadInput(f"{what} cannot be read: {_told(error)}") from error


def _told(error: BaseException) -> str:
    """In one line; a system's errors speak for themselves."""
    words = " ".join(str(error).split())
    named = isinstance(error, OSError | TypeError | NotImplementedError)
    return words if named and words else f"{type(error).__name__}: {words}".removesuffix(": ")
