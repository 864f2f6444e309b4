"""A clock that commands read one after the other, and nobody sets: it runs while the machine sleeps, and until it ends.

A machine's time of day may leap meanwhile, by hand or by the network.
"""

from __future__ import annotations

import time
from pathlib import Path

import msgspec

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)  # the latter on macOS, where it runs in sleep as well


class Moment(msgspec.Struct, frozen=True):
    boot: str  # which run of the machine; "" where the system does not tell
    seconds: float  # in it

    @staticmethod
    def now() -> Moment:
        try:
            boot = BOOT_ID.read_text(encoding="ascii").strip()
        except OSError:
            boot = ""
        return Moment(boot, time.clock_gettime(CLOCK))

    def until(self, later: Moment) -> float:
        """Seconds that have passed for certain: none where the machine has been started anew, or is another one."""
        return max(later.seconds - self.seconds, 0.0) if self.boot == later.boot else 0.0
