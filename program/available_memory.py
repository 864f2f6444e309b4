"""How much memory this machine has to spare."""

import os
from pathlib import Path

MEMINFO = Path("/proc/meminfo")
CONTROL_GROUP = Path("/sys/fs/cgroup")


def available_memory() -> int:
    """Bytes that could be taken without swapping; if the system does not tell (macOS), all that it has."""
    return min(_of_the_machine(), _of_the_container())


def _of_the_machine() -> int:
    lines = MEMINFO.read_text(encoding="ascii").splitlines() if MEMINFO.exists() else []
    found = (int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable:"))
    return next(found, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))


def _of_the_container() -> int:
    """What the control group leaves, if there is one that limits memory."""
    try:
        limit, used = ((CONTROL_GROUP / name).read_text(encoding="ascii") for name in ("memory.max", "memory.current"))
        return max(int(limit) - int(used), 0)
    except (OSError, ValueError):  # none, or "max"
        return 1 << 62
