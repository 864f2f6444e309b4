"""Whether searches without an end of their own go on for long: `VOLSPLAT_HYPOTHESIS=thorough` has them, CI does not."""

import os

PROFILE = os.environ.get("VOLSPLAT_HYPOTHESIS", "volsplat")
THOROUGH = PROFILE == "thorough"
