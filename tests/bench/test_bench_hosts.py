"""A small lab on one machine: its links are as slow as they should be, and nothing of it stays behind."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.patience import PATIENCE
from support.programs.programs import Person
from volsplat.bench.hosts.namespaces import BRIDGE, Host, lab, why_no_lab
from volsplat.protocol.text.errors import BadInput

WHY_NOT = why_no_lab()
needs_lab = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)
RATE = 80e6  # bits a second
TAKES_ALL = """
import socket, sys
listener = socket.create_server((sys.argv[1], 5000))
taken, _ = listener.accept()
while taken.recv(1 << 20):
    pass
taken.close()
"""

SENDS = """
import socket, sys
sender = socket.create_connection((sys.argv[1], 5000))
assert sender.recv(2) == b"go"
sender.sendall(bytes(int(sys.argv[2])))
sender.close()
"""


@pytest.fixture
def person(tmp_path: Path) -> Person:
    return Person(tmp_path)


@pytest.fixture
def hosts() -> Iterator[list[Host]]:
    with lab(2, RATE) as made:
        yield made


def interfaces(process: str) -> set[str]:
    """The names of those that a process sees."""
    lines = Path(process, "net", "dev").read_text(encoding="utf-8").splitlines()[2:]
    return {line.split(":")[0].strip() for line in lines}


def connected(host: Host) -> socket.socket:
    """Once somebody listens there."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return socket.create_connection((host.address, 5000), timeout=PATIENCE)
        except ConnectionRefusedError:
            assert time.monotonic() < deadline, "nobody listens"


def all_of(taken: socket.socket) -> int:
    """How many bytes come."""
    nbytes = 0
    while part := taken.recv(1 << 20):
        nbytes += len(part)
    return nbytes


@needs_lab
def test_a_link_is_as_slow_as_it_is_said_to_be(hosts: list[Host]) -> None:
    """Beyond the burst that leaves at once nothing is faster; how much slower is the machine's business."""
    nbytes = 4_000_000
    with hosts[1].start([sys.executable, "-c", TAKES_ALL, hosts[1].address]) as taker, connected(hosts[1]) as sender:
        began = time.perf_counter()
        sender.sendall(bytes(nbytes))
        sender.shutdown(socket.SHUT_WR)
        assert sender.recv(1) == b""
        seconds = time.perf_counter() - began
        assert taker.wait(PATIENCE) == 0
    assert seconds > 0.9 * 8 * nbytes / RATE


@needs_lab
def test_the_clients_link_is_shared_by_all_that_send_to_it() -> None:
    nbytes, senders = 1_000_000, 3
    with lab(1 + senders, RATE) as (client, *others), socket.create_server((client.address, 5000)) as listener:
        sending = [host.start([sys.executable, "-c", SENDS, client.address, str(nbytes)]) for host in others]
        taken = [listener.accept()[0] for _ in sending]
        began = time.perf_counter()
        for one in taken:
            one.sendall(b"go")
        came = sum(map(all_of, taken))
        seconds = time.perf_counter() - began
        for one, process in zip(taken, sending, strict=True):
            one.close()
            assert process.wait(PATIENCE) == 0
    assert came == senders * nbytes and seconds > 0.9 * 8 * came / RATE


@needs_lab
def test_hosts_do_not_see_one_anothers_loopback(hosts: list[Host]) -> None:
    with hosts[1].start([sys.executable, "-c", TAKES_ALL, "127.0.0.1"]) as alone:
        with pytest.raises(OSError):
            socket.create_connection(("127.0.0.1", 5000), timeout=PATIENCE)
        alone.kill()


@needs_lab
def test_other_programs_of_the_machine_see_nothing_of_a_lab(hosts: list[Host]) -> None:
    assert interfaces("/proc/thread-self") >= {BRIDGE, *(host.port for host in hosts)}
    assert BRIDGE not in interfaces(f"/proc/{os.getppid()}")


@needs_lab
def test_nothing_of_a_lab_stays_behind() -> None:
    with pytest.raises(BadInput, match="stop"), lab(2, RATE) as made:
        names = [host.namespace for host in made[1:]]
        raise BadInput("stop")
    listed = subprocess.run(["ip", "netns"], capture_output=True, text=True, check=True).stdout
    assert not any(name and name in listed for name in names)


@needs_lab
def test_frames_are_drawn_on_hosts_of_their_own(person: Person) -> None:
    done = person.runs(
        *("bench", "hosts", "--phantom", "shells:24", "--workers", "2", "--splat-servers", "1,2"),
        *("--link", "1000", "--image", "48", "--repeats", "2"),
    )
    assert done.returncode == 0, done.stderr
    assert "2 splat servers" in done.stdout and "times the frame rate" in done.stdout
