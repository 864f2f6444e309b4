"""Forks programs of volsplat from a process that has loaded what each would load again, for a second or two.

Run as `python -m support.programs.command_forker SOCKET STAND_IN FORKED`: the number of a listening socket, the command
that asks there (stand_in.py), and what of the programs that commands start is forked, too: `all` or `fork-servers`.
Ends, and with it all that it has forked, when its standard input does.
"""

import gc
import json
import os
import runpy
import signal
import socket
import sys
import threading
import traceback
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from selectors import EVENT_READ, DefaultSelector
from typing import Any, NoReturn

from support.patience import PATIENCE
from support.programs.process_marks import mark

STARTED_WITH = frozenset(os.environ)  # as OpenImageIO finds its fonts by a variable that it sets

from volsplat.bench.commands.command import SUMMARIES  # noqa: E402
from volsplat.client.command.cli import main as volsplat  # noqa: E402
from volsplat.client.command.commands import ENTRIES  # noqa: E402

CLIENT = ["figure.figure_file", "image.image_file", "scene.resized", "scene.view_sides"]
CLIENT += [f"ui.{name}" for name in ("application", "opening.start_page", "page")]
SERVERS = [
    "deploy.batch.task_pools",
    "mapshade_server.command",
    "splat_server.command",
    "mapshade_server.readers.medicine.nrrd",
]
LIBRARIES = ["torch", "SimpleITK", "OpenImageIO", "distributed", "zarr", "encodings.ascii", "encodings.idna"]
MODULES = [
    *(entry.module.format(name=name) for name, entry in ENTRIES.items() if not entry.program),
    *(f"volsplat.bench.commands.{name}_command" for name in SUMMARIES),
    *(f"volsplat.client.{name}" for name in CLIENT),
    *(f"volsplat.{name}" for name in SERVERS),
    *LIBRARIES,
]


@dataclass(eq=False)
class _Forked:
    """A program, and the connection of whoever waits for its status."""

    identity: int
    ended: int  # a file descriptor that is readable once the program has ended
    asker: socket.socket

    def stop(self) -> None:
        signal.pidfd_send_signal(self.ended, signal.SIGTERM)

    def report(self) -> None:
        """Hands the status on to who asked, unless nobody waits any more."""
        status = os.waitstatus_to_exitcode(os.waitpid(self.identity, 0)[1])
        os.close(self.ended)
        with self.asker:
            _tell(self.asker, status)


class _Forker:
    """Forks what is asked for at a socket, and watches it."""

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._running: set[_Forked] = set()
        self._selector = DefaultSelector()
        self._selector.register(listener, EVENT_READ)
        self._selector.register(sys.stdin, EVENT_READ)

    def serve(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is sys.stdin:
                    for forked in self._running:
                        forked.stop()
                    return
                if key.fileobj is self._listener:
                    self._fork(self._listener.accept()[0])
                elif key.fileobj == key.data.ended:
                    self._end(key.data)
                elif key.data in self._running:  # who asked was ended, as by Ctrl-C
                    key.data.stop()
                    self._selector.unregister(key.fileobj)

    def _fork(self, asker: socket.socket) -> None:
        try:
            request, streams = _request(asker)
        except (OSError, ValueError):  # who asked was ended meanwhile
            asker.close()
            return
        identity = os.fork()
        if identity == 0:
            for number, stream in enumerate(streams):
                os.dup2(stream, number)
                os.close(stream)
            self._let_go(asker)
            _become(**request)
        for stream in streams:
            os.close(stream)
        forked = _Forked(identity, os.pidfd_open(identity), asker)
        self._running.add(forked)
        _tell(asker, identity)
        self._selector.register(forked.ended, EVENT_READ, forked)
        self._selector.register(asker, EVENT_READ, forked)

    def _let_go(self, asker: socket.socket) -> None:
        """Close what is the forker's: others see by it when that ends."""
        self._listener.close()
        for held in (asker, *(forked.asker for forked in self._running)):
            held.close()

    def _end(self, forked: _Forked) -> None:
        self._running.remove(forked)
        self._selector.unregister(forked.ended)
        if forked.asker in self._selector.get_map():
            self._selector.unregister(forked.asker)
        forked.report()


def _tell(asker: socket.socket, number: int) -> None:
    with suppress(BrokenPipeError, ConnectionResetError):
        asker.sendall(number.to_bytes(8, "big", signed=True))


def _request(asker: socket.socket) -> tuple[dict[str, Any], list[int]]:
    """What is asked for, and the three streams of who asks."""
    asker.settimeout(PATIENCE)  # an asker has it all at hand
    length, streams, _, _ = socket.recv_fds(asker, 8, 3)
    with asker.makefile("rb") as rest:
        return json.loads(rest.read(int.from_bytes(length, "big"))), streams


def _become(words: list[str], folder: str, environment: dict[str, str]) -> NoReturn:
    os.setsid()  # a terminal's Ctrl-C reaches who asked
    os.chdir(folder)
    set_while_loading = {name: os.environ[name] for name in os.environ.keys() - STARTED_WITH}
    os.environ.clear()
    os.environ.update(set_while_loading | environment)
    if token := environment.get("VOLSPLAT_TOKEN"):
        mark(token)  # by which a person's servers are known
    status = _status_of(words)
    threading._shutdown()  # type: ignore[attr-defined]  # which waits for threads, as at the end of any program
    sys.stdout.flush()
    os._exit(status)  # taking down all that was loaded would cost half a second


def _status_of(words: list[str]) -> int:
    try:
        if words[0] == "-m":
            sys.argv = words[1:]
            sys.modules.pop(words[1], None)  # runpy warns of a module that has been loaded
            runpy.run_module(words[1], run_name="__main__", alter_sys=True)
        else:
            sys.argv = ["volsplat", *words]
            volsplat()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1 if end.code else 0
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def main() -> None:
    listener = socket.socket(fileno=int(sys.argv[1]))
    _, _, stand_in, forked = sys.argv
    if forked == "all":
        sys.executable = stand_in  # so that servers and what a command becomes are; before modules note it
    for name in MODULES:
        import_module(name)
    from volsplat.client.ui import application
    from volsplat.deploy import forked_servers

    application.RECONNECT_SECONDS = PATIENCE  # a page that a busy machine keeps waiting is not loaded anew
    forked_servers.COMMAND = (stand_in, "-m", forked_servers.FORK_SERVER)
    sys.modules["__main__"].__package__ = None  # by which click would call the command
    gc.freeze()  # what is collected by those that are forked is their own
    _Forker(listener).serve()
    os._exit(0)  # as those that it has forked


if __name__ == "__main__":
    main()
