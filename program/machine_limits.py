"""What this process may take of its machine: its control groups, of a container or a batch job, may leave it less."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

MEMINFO = Path("/proc/meminfo")
MOUNTED = Path("/sys/fs/cgroup")
OWN = Path("/proc/self/cgroup")
UNLIMITED = 1 << 62
_NUMBER_OF = re.compile(r"^(\w+) (\d+)$", re.MULTILINE)  # in memory.stat


class _MemoryFiles(NamedTuple):
    """What a version of control groups calls them."""

    limits: tuple[str, ...]  # beyond which a process is killed, or held up so that it hardly gets on
    used: str
    dropped: tuple[str, str]  # in memory.stat: what has been read of files, which makes room if there is need


MEMORY_FILES = (
    _MemoryFiles(("memory.max", "memory.high"), "memory.current", ("inactive_file", "active_file")),
    _MemoryFiles(("memory.limit_in_bytes",), "memory.usage_in_bytes", ("total_inactive_file", "total_active_file")),
)


def available_memory() -> int:
    """Bytes that this process could take without swapping; if the system does not tell (macOS), all that it has."""
    return min(_of_the_machine(), memory_left())


def _of_the_machine() -> int:
    lines = MEMINFO.read_text(encoding="ascii").splitlines() if MEMINFO.exists() else []
    found = (int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable:"))
    return next(found, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))


def memory_left() -> int:
    """Bytes that the tightest group still gives."""
    return min(map(_memory_left, _groups("memory")), default=UNLIMITED)


def core_limit() -> int:
    """How many cores the tightest group lets its processes keep busy; a part of one counts as one."""
    return min(map(_core_limit, _groups("cpu")), default=UNLIMITED)


def _groups(controller: str) -> Iterator[Path]:
    """Their folders, the innermost first. A container may see its own group alone, as the outermost."""
    for line in _text(OWN).splitlines():
        _, controllers, path = line.split(":", 2)
        if not controllers or controller in controllers.split(","):  # version 2 has one tree for all
            mounted = MOUNTED / controller if controllers else MOUNTED
            inner = mounted / path.lstrip("/")
            yield from (folder for folder in (inner, *inner.parents) if folder.is_relative_to(mounted))


def _memory_left(group: Path) -> int:
    for files in MEMORY_FILES:
        limits = [int(limit) for name in files.limits if (limit := _text(group / name)).isdecimal()]
        used = _text(group / files.used)
        if limits and used.isdecimal():
            known = dict(_NUMBER_OF.findall(_text(group / "memory.stat")))
            return max(min(limits) - int(used) + sum(int(known.get(name, 0)) for name in files.dropped), 0)
    return UNLIMITED


def _core_limit(group: Path) -> int:
    told = _text(group / "cpu.max") or " ".join(_text(group / f"cpu.cfs_{name}_us") for name in ("quota", "period"))
    quota = re.fullmatch(r"(\d+) ([1-9]\d*)", told)  # else there is none
    return max(-(-int(quota[1]) // int(quota[2])), 1) if quota else UNLIMITED


def _text(path: Path) -> str:
    """Empty if there is no such file: no Linux, another version, or a group of which this process sees nothing."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""
