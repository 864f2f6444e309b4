"""Where a caller's own code is, so that a warning points at it."""

import sys
from itertools import count

_PACKAGE = __name__.partition(".")[0]


def level_of_caller() -> int:
    """The `stacklevel` by which a warning of the function that asks points at the first line that is not ours."""
    asking = sys._getframe(1)
    for level in count(1):
        if asking.f_globals.get("__name__", "").partition(".")[0] != _PACKAGE or asking.f_back is None:
            return level
        asking = asking.f_back
    raise AssertionError("count() does not end")
