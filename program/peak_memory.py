"""The most memory that this process has held, for the report."""

import os
import resource
import sys

STATUS = "/proc/self/status"
STATUS_BYTES = 16384  # more than it has
PEAK = b"VmHWM:"


def peak_memory() -> int:
    """Bytes resident at the peak. On Linux getrusage would count the process that started this one as well."""
    if os.path.exists(STATUS) and PEAK in (status := _status()):
        return int(status.partition(PEAK)[2].split(maxsplit=1)[0]) * 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def _status() -> bytes:
    """Of this process. Read by the system's own calls, which take half the time: each frame asks."""
    status = os.open(STATUS, os.O_RDONLY)
    try:
        return os.read(status, STATUS_BYTES)
    finally:
        os.close(status)
