"""A data link between two servers ends, which are well and have their client: it is made anew, and nobody is lost."""

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
import torch
from faults.fault_runs import drawn_head

from support.programs.hand_started import free_port
from volsplat.client import Session
from volsplat.deploy.forked_servers import ForkedServers
from volsplat.deploy.server_command import Program
from volsplat.protocol.wire.tokens import Token, new_token

CHUNK = 1 << 16


class DataRelay:
    """Passes data links on to a splat server, and can end them."""

    def __init__(self, port: int) -> None:
        """The splat server's."""
        self._port = port
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listening.getsockname()[1]}"
        self.links: list[tuple[socket.socket, socket.socket]] = []  # of the worker, and of the splat server
        threading.Thread(target=self._accept, daemon=True).start()

    def end(self, sides: tuple[int, ...]) -> None:
        """End the newest link, on these sides alone: the other one does not hear of it."""
        for side in sides:
            self.links[-1][side].shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        for end in (self._listening, *(end for link in self.links for end in link)):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        with suppress(OSError):  # it is closed
            while True:
                near = self._listening.accept()[0]
                far = socket.create_connection(("127.0.0.1", self._port))
                self.links.append((near, far))
                for source, target in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=(source, target), daemon=True).start()

    def _pass_on(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(CHUNK):
                target.sendall(data)


@contextmanager
def relayed(volume: Path, workers: int) -> Iterator[tuple[Session, DataRelay]]:
    """A session of these servers, and the relay by which they reach the splat server."""
    token, port = new_token(), free_port()
    with ExitStack() as ended:
        forks = ForkedServers()
        ended.callback(forks.end)
        relay = DataRelay(port)
        ended.callback(relay.close)
        session = ended.enter_context(Session(volume, workers=workers, spawn=False, token=token))
        data = ("--listen", f"127.0.0.1:{port}", "--advertise", relay.address)
        for program, options in ((Program.SPLAT_SERVER, data), *[(Program.MAPSHADE_SERVER, ())] * workers):
            _start(forks, program, session, token, options)
        yield session, relay


def _start(forks: ForkedServers, program: Program, session: Session, token: Token, options: tuple[str, ...]) -> None:
    arguments = ("--connect", str(session.address), *options, "--threads", "1")
    forks.start(program, arguments, token.added_to({}))


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("sides", [(0, 1), (0,), (1,)], ids=["both hear", "worker hears", "splat server hears"])
def test_a_data_link_that_ends_costs_no_server(workers: int, sides: tuple[int, ...]) -> None:
    with drawn_head() as head, relayed(head.volume, workers) as (session, relay):
        assert torch.equal(session.render(head.scene), head.image)
        assert len(relay.links) == workers
        for _ in range(5):
            relay.end(sides)
            for _ in range(2):  # the first may be drawn before the end is heard of
                assert torch.equal(session.render(head.scene), head.image)
        assert len(relay.links) > workers
        assert not any(server.lost for server in session.servers)
