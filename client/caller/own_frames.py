"""Where a caller's own code is, so that a warning points at it."""

import sys

_PACKAGE = __name__.partition(".")[0]


def level_of_caller() -> int:
    """The `stacklevel` by which a warning of the function that asks points at the first line that is not ours."""
    asking, level = sys._getframe(1), 1
    while asking.f_globals.get("__name__", "").partition(".")[0] == _PACKAGE and asking.f_back is not None:
        asking, level = asking.f_back, level + 1
    return level
