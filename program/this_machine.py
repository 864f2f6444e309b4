"""The machine that this process runs on, for reports."""

import os
import platform
import socket
from functools import cache
from pathlib import Path

from volsplat.program.machine_limits import core_limit
from volsplat.protocol.description.machine import LONGEST_TEXT, Machine
from volsplat.protocol.text.errors import BadInput

CPUS = Path("/proc/cpuinfo")
# Of one machine. Each has walkers enough for its share of the cores, and more of them only cost: on 16 cores frames of
# 16 servers take 1.2 to 1.5 times as long as those of 4.
ENOUGH_SERVERS = 4
MOST_SERVERS = 256  # a mistyped number fills the machine with processes, which nobody can end any more


@cache
def this_machine() -> Machine:
    host, known = socket.gethostname(), os.uname()  # for which `platform` would start a program, in each server
    system = f"{known.sysname}-{known.release}-{known.machine}"
    return Machine(host[:LONGEST_TEXT], system[:LONGEST_TEXT], _cpu_name()[:LONGEST_TEXT], usable_cores())


def usable_cores() -> int:
    """The cores that this process may use: a job of a cluster, or a container, seldom has all of its machine's."""
    bound = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(bound, core_limit())


def usual_servers() -> int:
    """How many map/shade servers start on this machine if nobody says how many."""
    return min(usable_cores(), ENOUGH_SERVERS)


def check_server_count(count: int) -> None:
    """Raises BadInput for more servers than are started on this machine."""
    if count > MOST_SERVERS:
        raise BadInput(
            f"{count} servers are too many for this machine, where {MOST_SERVERS} start at the most; "
            "each draws with several threads, and a cluster file names more machines"
        )


def _cpu_name() -> str:
    try:
        lines = CPUS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def process_name(name: str = "") -> str:
    """What other processes call this one in messages: its host and process id, and the name that it was given."""
    return f"{socket.gethostname()}, process {os.getpid()}" + (f", {name}" if name else "")
