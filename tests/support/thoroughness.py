"""Whether searches without an end of their own go on for long: `VOLSPLAT_HYPOTHESIS=thorough` has them, CI does not."""

import os

PROFILE = os.environ.get("VOLSPLAT_HYPOTHESIS", "volsplat")
THOROUGH = PROFILE == "thorough"
TIMES = 20  # as many examples


def examples(count: int) -> int:
    """How many examples a search has that does with so many in CI."""
    return TIMES * count if THOROUGH else count
