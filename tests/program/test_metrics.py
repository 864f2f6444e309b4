"""Metrics for Prometheus: true numbers of real servers, for nobody without the door's token."""

import os
import socket
import stat
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from support.files.head_volume import head, scene, single
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.programs import Person
from volsplat.client import Session
from volsplat.program import metrics_door
from volsplat.program.counts import Counts
from volsplat.program.metrics_door import MOST_AT_ONCE, MetricsDoor, door_token
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.tokens import Token, new_token

__all__ = ["head", "scene", "single"]

Samples = dict[tuple[str, str], float]  # by name and label


def scraped(address: Address, token: Token) -> Samples:
    asked = urllib.request.Request(
        f"http://{address}/metrics", headers={"Authorization": f"Bearer {token.key.decode()}"}
    )
    with urllib.request.urlopen(asked, timeout=PATIENCE) as answer:
        text = answer.read().decode()
    samples = (sample for family in text_string_to_metric_families(text) for sample in family.samples)
    return {(sample.name, "".join(sample.labels.values())): sample.value for sample in samples}


def status(address: Address, path: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(
            urllib.request.Request(f"http://{address}{path}", headers=headers), timeout=PATIENCE
        ) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        with error:
            return error.code


@pytest.fixture
def door() -> Iterator[tuple[MetricsDoor, Token, Counts]]:
    token, counts = new_token(), Counts()
    door = MetricsDoor(Address(LOOPBACK, 0), token, lambda: counts)
    yield door, token, counts
    door.close()


def test_nobody_is_told_without_the_token(door: tuple[MetricsDoor, Token, Counts]) -> None:
    address, secret = door[0].address, door[1].key.decode()
    for wrong in ({}, {"Authorization": secret}, {"Authorization": f"Bearer {secret}x"}, {"Authorization": "Bearer é"}):
        assert status(address, "/metrics", **wrong) == 401
        assert status(address, "/elsewhere", **wrong) == 401
    assert status(address, "/metrics", Authorization=f"Bearer {secret}") == 200
    assert status(address, "/elsewhere", Authorization=f"Bearer {secret}") == 404


def test_who_connects_and_says_nothing_keeps_nobody_out(door: tuple[MetricsDoor, Token, Counts]) -> None:
    address = door[0].address
    silent = [socket.create_connection((address.host, address.port)) for _ in range(3 * MOST_AT_ONCE)]
    try:

        def answers() -> bool:
            try:
                return status(address, "/metrics") == 401
            except OSError:  # no room yet
                return False

        wait_until(answers, "answered while silent callers hung on")
    finally:
        for one in silent:
            one.close()


def test_who_sends_a_byte_now_and_then_keeps_nobody_out(
    door: tuple[MetricsDoor, Token, Counts], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metrics_door, "PATIENCE", 1.0)
    address, done = door[0].address, threading.Event()

    def dribbles(slow: socket.socket) -> None:
        with suppress(OSError):  # hung up on
            while not done.wait(0.1):
                slow.sendall(b"x")

    slow = [socket.create_connection((address.host, address.port)) for _ in range(MOST_AT_ONCE)]
    threads = [threading.Thread(target=dribbles, args=(one,)) for one in slow]
    for thread in threads:
        thread.start()

    def answers() -> bool:
        try:
            return status(address, "/metrics") == 401
        except OSError:  # no room yet
            return False

    try:
        wait_until(answers, "answered while slow callers hung on")
    finally:
        done.set()
        for thread, one in zip(threads, slow, strict=True):
            thread.join()
            one.close()


@pytest.mark.parametrize("host", ["::1", "::", "127.0.0.1", "localhost"])
def test_a_door_opens_at_any_address_and_looks_no_name_up(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def takes_long(name: str = "") -> str:
        raise AssertionError(f"{name} was looked up")

    monkeypatch.setattr(socket, "getfqdn", takes_long)
    token = new_token()
    door = MetricsDoor(Address(host, 0), token, Counts)
    try:
        reached = door.address._replace(host="::1") if host == "::" else door.address
        assert scraped(reached, token)["volsplat_peak_memory_bytes", ""] > 1e6
    finally:
        door.close()


def test_what_is_added_is_told(door: tuple[MetricsDoor, Token, Counts]) -> None:
    made, token, counts = door
    counts.add("frames", of="finished")
    counts.add("frames", of="finished")
    counts.add("packets", 12.0)
    told = scraped(made.address, token)
    assert told["volsplat_frames_total", "finished"] == 2
    assert told["volsplat_packets_total", ""] == 12
    assert told["volsplat_peak_memory_bytes", ""] > 1e6


def test_the_tokens_file_is_its_owners_alone(tmp_path: Path) -> None:
    token = door_token(tmp_path / "token")
    assert stat.S_IMODE(os.stat(tmp_path / "token").st_mode) == 0o600
    assert door_token(tmp_path / "token").key == token.key
    (tmp_path / "token").chmod(0o644)
    with pytest.raises(BadInput, match="can be read by others"):
        door_token(tmp_path / "token")


def test_servers_that_start_at_once_make_one_token(tmp_path: Path) -> None:
    together = threading.Barrier(4)

    def made(path: Path) -> bytes:
        together.wait()
        return door_token(path).key

    with ThreadPoolExecutor(4) as pool:
        for attempt in range(25):
            assert len(set(pool.map(made, [tmp_path / f"token-{attempt}"] * 4))) == 1
    assert len(list(tmp_path.iterdir())) == 25


@contextmanager
def ended(programs: "list[subprocess.Popen[bytes]]") -> Iterator[None]:
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait(PATIENCE)


def test_servers_tell_what_their_frames_took(head: Path, scene: Scene, tmp_path: Path) -> None:
    session_token, token, places = new_token(), door_token(tmp_path / "token"), {}
    programs: list[subprocess.Popen[bytes]] = []
    with Session(head, workers=1, spawn=False, token=session_token) as session, ended(programs):
        for module in ("mapshade_server", "splat_server"):
            places[module] = Address(LOOPBACK, free_port())
            options = ["--metrics", str(places[module]), "--metrics-token", str(tmp_path / "token")]
            command = [sys.executable, "-m", f"volsplat.{module}", "--connect", str(session.address), *options]
            environment = {**os.environ, "VOLSPLAT_TOKEN": session_token.key.decode()}
            programs.append(subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL))
        outcomes = [session.finish(scene).outcome for _ in range(2)]
        mapped, splatted = (scraped(place, token) for place in places.values())
        packets = sum(stats.packets for one in outcomes if one for stats in one.servers.map_shade.values())
        assert mapped["volsplat_frames_total", "finished"] == splatted["volsplat_frames_total", "finished"] == 2
        assert mapped["volsplat_packets_total", ""] == splatted["volsplat_packets_total", ""] == packets > 0
        assert mapped["volsplat_batches_total", ""] >= 2
        assert splatted["volsplat_frame_seconds_total", "splat"] > 0
        assert session.counts.sums()["frames", "finished"] == 2
        assert session.counts.sums()["packets", ""] == packets
        assert not any(what == "losses" for what, _ in session.counts.sums())
        programs[0].kill()
        wait_until(lambda: session.counts.sums().get(("losses", "map/shade server")), "counted the loss")


def test_a_door_without_a_token_is_refused(tmp_path: Path) -> None:
    done = Person(tmp_path).runs("view", "none.nrrd", "--metrics", ":0", "--no-browser")
    assert done.returncode == 2 and "--metrics-token FILE" in done.stderr
