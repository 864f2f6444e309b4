"""Someone on the path who passes everything on, and keeps what was said first in both directions."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Self

from volsplat.protocol.wire.addresses import Address

MOST_KEPT = 1 << 16  # bytes of each direction: a handshake takes less, with TLS as well


@dataclass
class Recorded:
    """One connection."""

    dialler: bytearray = field(default_factory=bytearray)
    accepter: bytearray = field(default_factory=bytearray)
    over: bool = False  # nothing comes any more


class Recorder:
    """Listens; each caller is connected to `target`."""

    def __init__(self, target: Address, host: str) -> None:
        self._target = target
        self._port = socket.create_server((host, 0))
        self.address = Address(*self._port.getsockname()[:2])
        self.recorded: list[Recorded] = []
        threading.Thread(target=self._accept, name="recorder", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            self._port.shutdown(socket.SHUT_RDWR)
        self._port.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._port.accept()
                far = self._dialled(near)
                if far is None:
                    continue
                self.recorded.append(one := Recorded())
                threading.Thread(target=self._pass_both, args=(near, far, one), name="recorder", daemon=True).start()

    def _dialled(self, near: socket.socket) -> socket.socket | None:
        try:
            return socket.create_connection(self._target)
        except OSError:  # it is not up yet, or has ended
            near.close()
            return None

    def _pass_both(self, near: socket.socket, far: socket.socket, one: Recorded) -> None:
        back = threading.Thread(target=self._pass_on, args=(far, near, one.accepter), name="recorder", daemon=True)
        with near, far:
            back.start()
            self._pass_on(near, far, one.dialler)
            back.join()
        one.over = True

    @staticmethod
    def _pass_on(source: socket.socket, target: socket.socket, kept: bytearray) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                kept += data[: MOST_KEPT - len(kept)]
                target.sendall(data)
        with suppress(OSError):
            target.shutdown(socket.SHUT_RDWR)


@contextmanager
def played(said: bytes, host: str) -> Iterator[Address]:
    """A port whose first caller hears this, whatever it says."""

    def play() -> None:
        with suppress(OSError):
            caller, _ = port.accept()
            with caller:
                caller.sendall(said)
                while caller.recv(1 << 16):
                    pass

    with socket.create_server((host, 0)) as port:
        threading.Thread(target=play, name="player", daemon=True).start()
        yield Address(*port.getsockname()[:2])
