"""A line that holds each Ethernet frame back for a time, between two TAP devices (this kernel has no netem)."""

import fcntl
import os
import select
import struct
import threading
import time
from collections import deque

TUNSETIFF = 0x400454CA  # of <linux/if_tun.h>
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
LONGEST_FRAME = 2048  # bytes; the system cuts what is longer, as the device takes no part of that work


class DelayLine:
    """Made as two devices of these names, which may be moved to other namespaces. Passes nothing on after close()."""

    def __init__(self, names: tuple[str, str], seconds: float) -> None:
        self._seconds = seconds
        self._ends = [_tap(name) for name in names]
        self._closed = threading.Event()
        self._threads = [
            threading.Thread(target=self._pass_on, args=(one, other), name="delay line", daemon=True)
            for one, other in (self._ends, self._ends[::-1])
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """The devices are gone after it."""
        self._closed.set()
        for thread in self._threads:
            thread.join()
        for end in self._ends:
            os.close(end)

    def _pass_on(self, source: int, target: int) -> None:
        held = deque[tuple[float, bytes]]()  # and when each is due
        while not self._closed.is_set():
            due = held[0][0] - time.monotonic() if held else self._seconds
            if due > 0 and select.select([source], [], [], due)[0]:
                held.append((time.monotonic() + self._seconds, os.read(source, LONGEST_FRAME)))
            while held and held[0][0] <= time.monotonic():
                _put(target, held.popleft()[1])


def _tap(name: str) -> int:
    device = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    return device


def _put(device: int, frame: bytes) -> None:
    try:
        os.write(device, frame)
    except OSError:  # the device is down: the frame is lost, as on any line
        return
