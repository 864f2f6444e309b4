"""The machine that a process runs on, for reports."""

import os
import platform
import socket
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from volsplat.protocol.printable import printable

LONGEST_TEXT = 255  # characters
CPUS = Path("/proc/cpuinfo")

Text = Annotated[str, Meta(max_length=LONGEST_TEXT)]


class Machine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a machine calls itself and what it computes with; the texts are made printable, for they are shown."""

    host: Text
    system: Text
    cpu: Text
    cores: Annotated[int, Meta(ge=1, le=1 << 20)]  # that this process may use

    def __post_init__(self) -> None:
        for field in ("host", "system", "cpu"):
            msgspec.structs.force_setattr(self, field, printable(getattr(self, field)))


@cache
def this_machine() -> Machine:
    host, system = socket.gethostname(), platform.platform(terse=True)
    return Machine(host[:LONGEST_TEXT], system[:LONGEST_TEXT], _cpu_name()[:LONGEST_TEXT], usable_cores())


def usable_cores() -> int:
    """The cores that this process may use: a job of a cluster seldom has all of its machine's."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cpu_name() -> str:
    try:
        lines = CPUS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
