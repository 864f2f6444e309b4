"""gemmi's exceptions, turned into one line of BadInput."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from volsplat.protocol.text.errors import BadInput


@contextmanager
def one_line_errors(path: Path, what: str) -> Iterator[None]:
    """For all that takes values out of gemmi's objects: texts that are no UTF-8 are found only then."""
    try:
        yield
    except UnicodeDecodeError:
        raise _damaged(path, what, "it has letters where none can be") from None
    except (RuntimeError, ValueError, IndexError, MemoryError) as error:
        reason = " ".join(str(error).split()).replace(str(path), "").rstrip(" :")
        raise _damaged(path, what, reason) from None


def _damaged(path: Path, what: str, reason: str) -> BadInput:
    return BadInput(f"{path}: is no {what} or a damaged one: {reason}; fetch it again")
