"""A session that draws while strangers come: a client, two map/shade servers and a splat server, and one that waits.

The servers are processes started by hand; someone on the path of each link records how it begins.
"""

import hashlib
import os
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import psutil
from security.landlock import has_landlock
from security.recorder import Recorder

from support.files.head_volume import skin
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from volsplat.client import Session
from volsplat.client.session.single import SingleProcess
from volsplat.deploy.server_command import Program, server_command
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.accepting import Accepter
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.calling import call
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.tokens import Token, new_token

HOST = "127.0.0.2"  # no Unix socket leads to a listener there, so that all goes by TCP
TURNS = ((0.0, 0.0, 0.0, 1.0), (0.0, 0.6, 0.0, 0.8), (0.48, 0.6, 0.0, 0.64))  # views that are drawn by turns
WHILE_DRAWING = 3  # frames at least


class Besieged:
    """The session, its processes and their ports."""

    def __init__(self, head: Path, encryption: Encryption) -> None:
        self.head, self.encryption, self.token = head, encryption, new_token()
        self.earlier = new_token()  # which the server that waits was started with before
        self._ended = ExitStack()
        self.processes: dict[str, psutil.Process] = {}  # of the servers, by a name
        with SingleProcess(head) as single:
            scenes = [turned(skin(single), rotation) for rotation in TURNS]
            self._right = [(scene, bits(single, scene)) for scene in scenes]
        with ExitStack() as unless_up:
            unless_up.enter_context(self._ended)
            self._servers = self._ended.enter_context(ExitStack())  # which end when no session needs them any more
            tls = encryption is Encryption.ALWAYS
            self.session = self._ended.enter_context(
                Session(head, workers=2, listen=Address(HOST, 0), spawn=False, token=self.token, tls=tls)
            )
            self.data = Address(HOST, free_port())  # where the splat server takes links
            self.waits = Address(HOST, free_port())  # where another map/shade server waits for a client of its own
            self.to_client, self.to_data = self._recorder(self.session.address), self._recorder(self.data)
            listens = ["--listen", str(self.data), "--advertise", str(self.to_data.address)]
            self.start("splat", Program.SPLAT_SERVER, *self._dials, *listens)
            self.start("map/shade 1", Program.MAPSHADE_SERVER, *self._dials, *self._held_to)
            self.start("map/shade 2", Program.MAPSHADE_SERVER, *self._dials, *self._held_to)
            self._start_waiting(self.earlier)
            self.called(self.earlier, self.waits).close()
            self._end_waiting()
            self._start_waiting(self.token)
            wait_until(lambda: len(self.session.servers) == 3, "have all joined")
            assert self.frame_is_right(0)
            unless_up.pop_all()

    @property
    def addresses(self) -> dict[str, Address]:
        """All ports that strangers reach."""
        return {"client": self.session.address, "data": self.data, "waiting": self.waits}

    @property
    def _dials(self) -> list[str]:
        return ["--connect", str(self.to_client.address)]

    @property
    def _held_to(self) -> list[str]:
        return ["--data-root", str(self.head.parent)] if has_landlock() else []

    def start(self, name: str, program: Program, *arguments: str, token: Token | None = None) -> None:
        command = [*server_command(program, *arguments), "--threads", "1", *self.encryption.options]
        process = subprocess.Popen(command, env=(token or self.token).added_to(os.environ))
        self._servers.callback(process.wait, PATIENCE)
        self._servers.callback(process.terminate)
        self.processes[name] = psutil.Process(process.pid)

    def _start_waiting(self, token: Token) -> None:
        resident = ["--wait-at", str(self.waits), "--resident"]
        self.start("waiting", Program.MAPSHADE_SERVER, *resident, *self._held_to, token=token)
        wait_until(lambda: listens_at(self.waits), "does it wait")

    def _end_waiting(self) -> None:
        self.processes["waiting"].terminate()
        wait_until(lambda: not listens_at(self.waits), "has it ended")

    def called(self, token: Token, at: Address) -> Connection:
        """A client's connection to a server that waits."""
        return call(
            at, "the server", Accepter(Role.CLIENT, token), encryption=self.encryption, patience=PATIENCE,
            report=lambda line: None, given_up=lambda: False,
        )  # fmt: skip

    def dialled(self, role: Role, token: Token, at: Address, server: int = 0, patience: float = 0) -> Connection:
        """A server's connection to the client, or a data link's to the splat server."""
        expected = Role.SPLAT_SERVER if role is Role.DATA_LINK else Role.CLIENT
        hello = new_hello(role, server=server)
        return connect(at, hello, token, expected, encryption=self.encryption, patience=patience)

    @property
    def workers(self) -> list[int]:
        """The map/shade servers that draw."""
        return [one.id for one in self.session.servers if one.role is Role.MAPSHADE_SERVER and not one.lost]

    @contextmanager
    def rogue_data_link(self) -> Iterator[Connection]:
        """A data link as the client has a worker of its own make it, here one that means harm."""
        with self.dialled(Role.MAPSHADE_SERVER, self.token, self.session.address) as worker:
            route = invited(worker)
            token = self.token.bound_to(route.key)
            with self.dialled(Role.DATA_LINK, token, Address(route.host, route.port), worker.id, PATIENCE) as link:
                yield link

    def close(self) -> None:
        self._ended.close()

    def frame_is_right(self, number: int) -> bool:
        scene, right = self._right[number % len(self._right)]
        return bits(self.session, scene) == right

    @contextmanager
    def drawing(self) -> Iterator["Drawing"]:
        """Frames are drawn meanwhile, all of them right; afterwards all stands as it did before."""
        living, servers = self._living(), self.session.servers
        drawing = Drawing(self)
        try:
            yield drawing
            drawing.go_on()
        finally:
            drawing.end()
        assert not drawing.wrong, f"frames {drawing.wrong} have other bits"
        assert self._living() == living, "a process has ended"
        assert [one.id for one in self.session.servers if not one.lost] == [one.id for one in servers if not one.lost]

    def _living(self) -> list[str]:
        return [
            name
            for name, process in self.processes.items()
            if process.is_running() and process.status() != psutil.STATUS_ZOMBIE
        ]

    def _recorder(self, target: Address) -> Recorder:
        return self._ended.enter_context(Recorder(target, HOST))


class Drawing:
    """A thread that draws one frame after the other."""

    def __init__(self, besieged: Besieged) -> None:
        self._besieged = besieged
        self.frames = 0
        self.wrong: list[int] = []
        self._failure: Exception | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._draw, name="drawing", daemon=True)
        self._thread.start()

    def go_on(self) -> None:
        """Wait until some more frames have been drawn."""
        wanted = self.frames + WHILE_DRAWING
        wait_until(lambda: self._failure or self.frames >= wanted, "were more frames drawn")
        assert self._failure is None, self._failure

    def end(self) -> None:
        self._over.set()
        self._thread.join(PATIENCE)

    def _draw(self) -> None:
        try:
            while not self._over.is_set():
                if not self._besieged.frame_is_right(self.frames):
                    self.wrong.append(self.frames)
                self.frames += 1
        except Exception as error:
            self._failure = error


def invited(worker: Connection) -> messages.Route:
    """Where a worker that has just joined is to send its batches."""
    while received := worker.receive():
        match received.message:
            case messages.DescribeMachine():
                worker.send(messages.MachineDescribed(memory_bytes=1 << 30, threads=1))
            case messages.ConnectToSplatServers(routes=[route]):
                return route
    raise AssertionError(f"{worker} invited nobody")


def turned(scene: Scene, rotation: tuple[float, float, float, float]) -> Scene:
    view: View = msgspec.structs.replace(scene.view, rotation=rotation)
    return msgspec.structs.replace(scene, view=view)


def bits(renderer: Session | SingleProcess, scene: Scene) -> str:
    return hashlib.sha256(renderer.render(scene).numpy().tobytes()).hexdigest()


def listens_at(address: Address) -> bool:
    return any(
        one.status == psutil.CONN_LISTEN and one.laddr == tuple(address) for one in psutil.net_connections("tcp4")
    )


def taken_in(processes: Sequence[psutil.Process]) -> dict[int, tuple[int, int]]:
    """What each process holds open, and how many threads it has."""
    return {process.pid: (process.num_fds(), process.num_threads()) for process in processes}
