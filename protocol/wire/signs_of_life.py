"""Signs of life that something outside of the interpreter gives: a library may hold that for seconds."""

from collections.abc import Callable
from typing import Protocol


class SignsOfLife(Protocol):
    """Made ready, and sent one by one over a connection, on which nobody else may send before take_back()."""

    @property
    def left(self) -> int:
        """How many have not been sent."""

    def take_back(self) -> bytes:
        """Have no more sent. The bytes of those that were not: on an encrypted connection they must go first."""


# The socket's descriptor, the signs in order, and seconds between them. Raises RuntimeError for want of a thread.
GiveSigns = Callable[[int, list[bytes], float], SignsOfLife]
# The socket's descriptor, and what makes the next sign ready.
LeaveSigns = Callable[[int, Callable[[], bytes]], SignsOfLife | None]
