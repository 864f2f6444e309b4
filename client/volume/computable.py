"""What cannot be computed with is the mistake of whoever asked for it."""

from collections.abc import Iterator
from contextlib import contextmanager

from volsplat.protocol.text.errors import BadInput


@contextmanager
def computable() -> Iterator[None]:
    """Raises BadInput where the rules of what is within raise ValueError."""
    try:
        yield
    except ValueError as error:
        raise BadInput(str(error)) from error
