"""The splat server as a process of its own, with token holders that send what nobody asked for, or pose as others."""

import os
import secrets
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import psutil
import pytest

from support.patience import PATIENCE, wait_until
from support.scenes.phantoms import QUANTISATION, shaded_scene
from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.roles import DATA_LINK_TO_SPLAT, Role
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.rules.levels import own_resolution
from volsplat.protocol.text.errors import BadInput, PeerLost
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import encode
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.port import MOST_PENDING
from volsplat.protocol.wire.tokens import Token, new_token

HONEST, LIAR, LATE = 1, 2, 9
KEYS = {worker: secrets.token_bytes(messages.WORKER_KEY_BYTES) for worker in (HONEST, LIAR, LATE)}
GEOMETRY = Geometry(dims=(8, 8, 8))
SCENE = shaded_scene(View(zoom=3.0), (32, 32))
BATCHES = 60_000  # weighing 1.2 kB each, if they are kept
MOST_GROWTH = 40 << 20  # bytes


@dataclass
class Attacked:
    """The server and what it is told."""

    program: "subprocess.Popen[str]"
    process: psutil.Process
    control: Connection
    token: Token
    links: list[Connection] = field(default_factory=list)

    def linked(self, worker: int) -> Connection:
        """A data link of a worker that knows its key."""
        return self.dials(worker, self.token.bound_to(KEYS[worker]))

    def dials(
        self, worker: int, token: Token, patience: float = PATIENCE, given_up: Callable[[], bool] = lambda: False
    ) -> Connection:
        """A data link of someone who says that he is this worker."""
        peer = self.control.peer
        address = Address(peer.data_host, peer.data_port)
        hello = new_hello(Role.DATA_LINK, server=worker)
        link = connect(address, hello, token, Role.SPLAT_SERVER, server=1, patience=patience, given_up=given_up)
        self.links.append(link)
        return link

    def invites(self, *workers: int) -> None:
        self.control.send(messages.InviteWorkers({worker: KEYS[worker] for worker in workers}))

    def says(self) -> str:
        """The next line on the server's stderr."""
        assert self.program.stderr is not None
        return self.program.stderr.readline()

    def draws(self, frame: int, links: dict[int, Connection]) -> messages.FrameFinished:
        """A frame without a packet."""
        self.begins(frame, list(links))
        for worker, link in links.items():
            link.send(empty(frame, worker, 0, last=True))
        return self.finishes()

    def begins(self, frame: int, workers: list[int]) -> None:
        drawing = Drawing.planned(SCENE, Step.F, GEOMETRY, QUANTISATION, own_resolution(GEOMETRY, Step.F))
        regions = RegionShares().regions(drawing.plan, {1: 1})
        self.control.send(messages.RenderFrame(frame, 1, drawing, dict.fromkeys(workers, 1), regions, exact=True))

    def finishes(self) -> messages.FrameFinished:
        while (received := self.control.receive()) is not None:
            if isinstance(received.message, messages.FrameFinished):
                return received.message
        raise AssertionError("the server is gone")


def empty(frame: int, worker: int, sequence: int, last: bool = False) -> messages.Batch:
    return messages.Batch(frame, worker, 0, sequence, 0, [messages.BatchPart(0, 0)], 0, 0, last)


@pytest.fixture
def attacked() -> Iterator[Attacked]:
    token = new_token()
    with Listener(Role.CLIENT, token) as clients:
        command = [sys.executable, "-m", "volsplat.splat_server", "--connect", str(clients.address), "--threads", "1"]
        environment = token.added_to(os.environ)
        with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
            control = clients.accept(PATIENCE)
            assert control is not None
            attacked = Attacked(process, psutil.Process(process.pid), control, token)
            attacked.invites(HONEST, LIAR)
            yield attacked
            control.send(messages.EndSession())
            _, said = process.communicate(timeout=PATIENCE)
            assert process.returncode == 0, said
            assert "Traceback" not in said
            for connection in (control, *attacked.links):
                connection.close()


def flood(link: Connection, rising: bool) -> int:
    """Empty batches of frames that nobody asked for, as many as are taken at once; how many that were."""
    link._socket.settimeout(PATIENCE if rising else 1.0)  # those of one frame are not all taken, however long one waits
    for n in range(BATCHES):
        batch = empty(10 + n, LIAR, 0) if rising else empty(10, LIAR, n)
        (control,) = encode(batch, speech=Speech(DATA_LINK_TO_SPLAT))
        try:
            link._socket.sendall(control)
        except TimeoutError:
            return n
    return BATCHES


@pytest.mark.parametrize("rising", [True, False], ids=["of ever newer frames", "of one frame"])
def test_batches_of_frames_to_come_take_no_more_memory_however_many_they_are(attacked: Attacked, rising: bool) -> None:
    links = {worker: attacked.linked(worker) for worker in (HONEST, LIAR)}
    assert attacked.draws(1, links).complete
    before = attacked.process.memory_info().rss
    taken = flood(links[LIAR], rising)
    assert taken == BATCHES if rising else taken < BATCHES, "the others wait in the socket"
    links[LIAR].close()
    attacked.begins(2, [HONEST, LIAR])
    links[HONEST].send(empty(2, HONEST, 0, last=True))
    assert attacked.finishes().lost == [LIAR]
    assert attacked.process.memory_info().rss - before < MOST_GROWTH
    assert attacked.draws(3, {HONEST: links[HONEST]}).complete


def test_links_that_are_made_again_and_again_leave_nothing_behind(attacked: Attacked) -> None:
    """A link that is held back is replaced: its thread goes with it."""
    honest = attacked.linked(HONEST)
    for _ in range(5):
        flood(attacked.linked(LIAR), rising=False)
    assert attacked.draws(1, {HONEST: honest}).complete
    wait_until(lambda: attacked.process.num_threads() < 20, "without threads of theirs")


@pytest.mark.parametrize("key", [None, LIAR], ids=["no key", "a key of another worker"])
def test_who_holds_the_token_cannot_take_the_place_of_a_worker(attacked: Attacked, key: int | None) -> None:
    honest = attacked.linked(HONEST)
    known = attacked.token if key is None else attacked.token.bound_to(KEYS[key])
    with pytest.raises(BadInput, match="does not know the key .* worker 1") as told:
        attacked.dials(HONEST, known)
    assert "\n" not in str(told.value)
    assert "does not know the key" in attacked.says()
    assert attacked.draws(2, {HONEST: honest}).complete


def test_the_key_alone_does_not_let_in(attacked: Attacked) -> None:
    """Whoever reads what goes over the wire learns it; the token stays unknown."""
    with pytest.raises(BadInput, match="does not know the key"):
        attacked.dials(HONEST, new_token().bound_to(KEYS[HONEST]))
    assert attacked.draws(2, {HONEST: attacked.linked(HONEST)}).complete


def test_links_of_workers_that_nobody_invited_take_no_room(attacked: Attacked) -> None:
    honest = attacked.linked(HONEST)
    before = attacked.process.num_threads()
    for n in range(MOST_PENDING + 3):
        with pytest.raises(PeerLost):
            attacked.dials(100 + n, attacked.token, patience=0)
    wait_until(lambda: attacked.process.num_threads() <= before + 2, "without threads of theirs")
    attacked.invites(HONEST, LATE)
    late = attacked.linked(LATE)
    assert attacked.draws(2, {HONEST: honest, LATE: late}).complete


def test_a_worker_that_comes_before_its_invitation_dials_again_until_it_is_there(attacked: Attacked) -> None:
    refused = threading.Event()

    def again() -> bool:
        refused.set()
        return False

    dialling = threading.Thread(
        target=attacked.dials, args=(LATE, attacked.token.bound_to(KEYS[LATE])), kwargs={"given_up": again}
    )
    dialling.start()
    assert refused.wait(PATIENCE)
    attacked.invites(LATE)
    dialling.join(PATIENCE)
    (late,) = attacked.links
    assert attacked.draws(2, {LATE: late}).complete
