"""The lab in a box is one: hosts that ssh reaches, and links that are cut and joined."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from support.lab.box import Box, box, why_no_box
from support.patience import PATIENCE, wait_until
from volsplat.bench.hosts.namespaces import Host

WHY_NOT = why_no_box()
pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)

SENDS_BACK = """
import socket, sys
listener = socket.create_server((sys.argv[1], 5000))
taken, _ = listener.accept()
while data := taken.recv(1 << 20):
    taken.sendall(data)
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Box]:
    with box(tmp_path_factory.mktemp("box"), ("client", "worker-1")) as made:
        yield made


def connected(host: Host) -> socket.socket:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return socket.create_connection((host.address, 5000), timeout=PATIENCE)
        except ConnectionRefusedError:
            assert time.monotonic() < deadline, "nobody listens"


def names(host: Host) -> list[str]:
    ids = set(host.processes())
    return [process.info["name"] for process in psutil.process_iter(["name"]) if process.pid in ids]


def said(box: Box, name: str, *command: str, at: str) -> str:
    words = [*box.hosts[at].inside, "ssh", "-F", str(box.ssh_config), name, *command]
    return subprocess.run(words, check=True, capture_output=True, text=True, timeout=PATIENCE).stdout


def test_ssh_reaches_each_host_from_each(small: Box) -> None:
    for name, host in small.hosts.items():
        for other in small.hosts:
            assert host.address in said(small, name, "ip", "-brief", "address", at=other)


def test_a_host_whose_link_is_down_hears_nothing_and_goes_on_when_it_is_up(small: Box) -> None:
    worker = small.hosts["worker-1"]
    with worker.start([sys.executable, "-c", SENDS_BACK, worker.address]) as echo, connected(worker) as link:
        small.cut_link("worker-1")
        link.sendall(b"there?")
        link.settimeout(0.5)
        with pytest.raises(TimeoutError):
            link.recv(6)
        small.join_link("worker-1")
        link.settimeout(PATIENCE)
        assert link.recv(6) == b"there?"
        link.shutdown(socket.SHUT_WR)
        assert echo.wait(PATIENCE) == 0


def test_nothing_of_a_box_stays_behind(tmp_path: Path) -> None:
    with box(tmp_path, ("client",)) as made:
        host = made.hosts["client"]
        asked = made.ssh("client", ["sleep", "1000"])
        wait_until(lambda: "sleep" in names(host), "begun by ssh")
        processes = host.processes()
    assert asked.wait(PATIENCE) != 0
    listed = subprocess.run(["ip", "netns"], capture_output=True, text=True, check=True).stdout
    assert host.namespace is not None and host.namespace not in listed
    wait_until(lambda: not any(map(psutil.pid_exists, processes)), "without its processes")
