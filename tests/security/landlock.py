"""Whether this kernel can hold a server to its data root."""

import ctypes

from volsplat.program.confinement import CREATE_RULESET

WHICH_VERSION = 1  # of Landlock; negative where there is none
WITHOUT = "this kernel has no Landlock"


def has_landlock() -> bool:
    return bool(ctypes.CDLL(None).syscall(CREATE_RULESET, None, 0, WHICH_VERSION) >= 1)
