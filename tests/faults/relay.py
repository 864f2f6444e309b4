"""A relay between a server and its client: a network that can be cut, swallow, crawl, delay and stall."""

import random
import socket
import threading
import time
from contextlib import suppress

CHUNK = 1 << 16
STALL_SECONDS = 0.25  # how long TCP waits before it sends again what was lost
SEGMENT = 1460  # bytes that are lost at a time


class Relay:
    """Takes one connection, and makes one to `target`. Any thread may change how it passes things on."""

    def __init__(self, target: tuple[str, int], seed: int) -> None:
        self._target = target
        self._random = random.Random(seed)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listening.getsockname()[1]}"
        self._lock = threading.Lock()  # guards _ends and _is_cut
        self._ends: list[socket.socket] = [self._listening]
        self._is_cut = False
        self._swallows = False
        self._bytes_a_second = 0.0  # 0: as many as come
        self._delay = 0.0  # seconds
        self._loss = 0.0  # part of the segments
        self._up = threading.Event()
        self._up.set()
        threading.Thread(target=self._accept, name="relay", daemon=True).start()

    def go_down(self) -> None:
        """Hold all that comes, until it heals."""
        self._up.clear()

    def swallow(self) -> None:
        self._swallows = True

    def slow_down(self, bytes_a_second: float) -> None:
        self._bytes_a_second = bytes_a_second

    def delay(self, seconds: float) -> None:
        self._delay = seconds

    def lose(self, part: float) -> None:
        self._loss = part

    def heal(self) -> None:
        """Pass on all that comes from now on, at once; but what swallows goes on so: no stream of TCP has a hole."""
        self._bytes_a_second, self._delay, self._loss = 0.0, 0.0, 0.0
        self._up.set()

    def cut(self) -> None:
        """Close both connections, and take no other."""
        self._up.set()
        with self._lock:
            self._is_cut = True
            for end in self._ends:
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
                end.close()

    def _accept(self) -> None:
        try:
            near = self._held(self._listening.accept()[0])
            far = self._held(socket.create_connection(self._target))
        except OSError:  # it is cut, or the session is over
            self.cut()
            return
        for one, other in ((near, far), (far, near)):
            threading.Thread(target=self._pass_on, args=(one, other), name="relay", daemon=True).start()

    def _held(self, end: socket.socket) -> socket.socket:
        """One that is closed when the relay is cut, if it is not yet."""
        with self._lock:
            self._ends.append(end)
            if self._is_cut:
                end.close()
        with suppress(OSError):  # it is closed
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return end

    def _pass_on(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(CHUNK):
                if self._swallows:
                    continue
                self._hold_up(len(data))
                target.sendall(data)
        self.cut()

    def _hold_up(self, nbytes: int) -> None:
        """A loss holds up all that comes after it, as TCP's does."""
        seconds = self._delay + (nbytes / self._bytes_a_second if self._bytes_a_second else 0.0)
        segments = -(-nbytes // SEGMENT)
        if self._loss and self._random.random() > (1 - self._loss) ** segments:
            seconds += STALL_SECONDS
        if seconds:
            time.sleep(seconds)
        self._up.wait()
