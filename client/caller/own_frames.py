"""Where a caller's own code is, so that a warning points at it."""

import sys

from volsplat.protocol.text.callers_lines import is_ours


def level_of_caller() -> int:
    """The `stacklevel` by which a warning of the function that asks points at the first line that is not ours."""
    asking, level = sys._getframe(1), 1
    while is_ours(asking) and asking.f_back is not None:
        asking, level = asking.f_back, level + 1
    return level
