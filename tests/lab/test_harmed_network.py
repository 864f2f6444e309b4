"""What the fault runs do to a host's network in the box is what it says, and is undone."""

import socket
import sys
import time
from collections.abc import Iterator

import psutil
import pytest

from support.lab.box import GIGABIT, Box, box, why_no_box
from support.lab.host_network import HostNetwork, why_unharmed
from support.patience import PATIENCE, wait_until
from volsplat.bench.hosts.namespaces import Host, do

WHY_NOT = why_no_box() or why_unharmed()
pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)

SHORT = 0.3  # seconds in which an answer would have come

SENDS_BACK = """
import socket, sys, threading
def serve(taken):
    while data := taken.recv(1 << 20):
        taken.sendall(data)
listener = socket.create_server((sys.argv[1], 5000))
while True:
    threading.Thread(target=serve, args=(listener.accept()[0],), daemon=True).start()
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Box]:
    with box(tmp_path_factory.mktemp("box"), ("worker-1",)) as made:
        yield made


class Echo:
    """A program of the host, and a connection to it."""

    def __init__(self, host: Host, process: psutil.Process) -> None:
        self._host, self.process = host, process
        self.link = self.connected()
        self.seconds()  # before the program has accepted it, it is not the program's

    def connected(self) -> socket.socket:
        listening = ("ss", "-Htln", "sport = :5000")
        wait_until(lambda: do(*self._host.inside, *listening), "listening")
        link = socket.create_connection((self._host.address, 5000), timeout=PATIENCE)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return link

    def seconds(self, nbytes: int = 1) -> float:
        """Until so much has come back."""
        began = time.perf_counter()
        self.link.sendall(bytes(nbytes))
        while nbytes:
            nbytes -= len(self.link.recv(nbytes))
        return time.perf_counter() - began


@pytest.fixture
def echo(small: Box) -> Iterator[Echo]:
    host = small.hosts["worker-1"]
    with host.start([sys.executable, "-c", SENDS_BACK, host.address]) as started:
        echo = Echo(host, psutil.Process(started.pid))
        yield echo
        echo.link.close()
        started.kill()


@pytest.fixture
def network(small: Box, echo: Echo) -> Iterator[HostNetwork]:
    network = HostNetwork(small.hosts["worker-1"], echo.process, GIGABIT)
    yield network
    network.heal()


def test_all_packets_are_held_back_for_as_long_and_no_longer_once_healed(echo: Echo, network: HostNetwork) -> None:
    network.delay(0.1)
    assert min(echo.seconds() for _ in range(3)) >= 0.2
    assert echo.seconds(200_000) >= 0.2  # more than a packet, whole
    network.heal()
    assert min(echo.seconds() for _ in range(20)) < 0.1


def test_lost_packets_come_later(echo: Echo, network: HostNetwork) -> None:
    network.lose(0.2)
    assert max(echo.seconds() for _ in range(60)) > 0.15  # TCP's first wait is 200 ms; none in 0.64 ** 60


def test_a_swallowed_connection_is_silent_while_another_one_is_not(echo: Echo, network: HostNetwork) -> None:
    network.swallow()
    echo.link.settimeout(SHORT)
    with pytest.raises(TimeoutError):
        echo.seconds()
    echo.link.close()
    echo.link = echo.connected()
    assert echo.seconds()


def test_a_cut_connection_is_known_as_such_at_once(echo: Echo, network: HostNetwork) -> None:
    network.cut()
    with pytest.raises(ConnectionError):
        echo.seconds()


def test_a_link_that_was_down_goes_on(echo: Echo, network: HostNetwork) -> None:
    network.go_down()
    echo.link.settimeout(SHORT)
    with pytest.raises(TimeoutError):
        echo.seconds()
    network.heal()
    echo.link.settimeout(PATIENCE)
    assert echo.link.recv(1)


def test_a_slow_link_is_slow(echo: Echo, network: HostNetwork) -> None:
    network.slow_down(1e6)
    assert echo.seconds(1_000_000) > 0.9
