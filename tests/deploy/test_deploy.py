"""A cluster over real processes: brought up once, used by one client after the other, ended; through sshd as well."""

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import msgspec
import psutil
import pytest
import torch

from support.files.small_disks import fill, small_disk
from support.patience import PATIENCE, wait_until
from support.programs.clusters import cluster_file, drawn, handles, servers_of, sshd
from support.programs.hand_started import free_port
from support.programs.programs import Person
from support.programs.server_processes import is_server
from volsplat.client import Session
from volsplat.client.command.movie_command import movie
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session import cluster_calls, cluster_watch
from volsplat.client.session.kept_cluster import KeptCluster
from volsplat.client.session.single import SingleProcess
from volsplat.deploy.cluster import cluster_use
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import ClusterState, StateFolder
from volsplat.deploy.doctor.doctor import Doctor
from volsplat.deploy.doctor.forecast import Size
from volsplat.protocol.messages.messages import DescribeMachine, MachineDescribed
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError
from volsplat.protocol.wire.accepting import Accepter
from volsplat.protocol.wire.addresses import parse_address
from volsplat.protocol.wire.calling import call
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.waiting import WaitingPort

__all__ = ["small_disk"]

LOCAL = 'launcher = "local"\nthreads = 1\n'


def by_hand() -> str:
    """A machine whose servers a person starts, and which wait for clients."""
    return f'launcher = "manual"\nmap-shade-servers = 1\nsplat-servers = 1\nlisten = "127.0.0.1:{free_port()}"\n'


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", size=(24, 24, 24)))
    return Person(tmp_path)


# Who starts a server and which side dials have nothing to do with each other: one test goes through all four.
EACH_KIND = ["local", "local, waiting", "ssh", "ssh, waiting"]


@pytest.fixture(params=["local", "ssh, waiting"])
def cluster(request: pytest.FixtureRequest, person: Person) -> Iterator[Path]:
    """A cluster's file; whatever was brought up of it is down at the end."""
    with ExitStack() as ended:
        ssh = request.param.startswith("ssh")
        machine = ended.enter_context(sshd(person.folder / "sshd")) + "threads = 1\n" if ssh else LOCAL
        machine = f'data-root = "{person.folder}"\nmap-shade-servers = 2\nsplat-servers = 1\n{machine}'
        if "waiting" in request.param:
            machine = f'listen = "127.0.0.1:{free_port()}"\n{machine}'
        path = cluster_file(person.folder, f"test-{os.getpid()}", machine)
        try:
            yield path
        finally:
            assert person.runs("deploy", "down", str(path)).returncode == 0


def unreached(servers: str) -> str:
    """A machine of these servers that ssh does not get to."""
    options = f'ssh = {{options = ["-p", "{free_port()}", "-F", "none"]}}\n'
    return f'launcher = "ssh"\nhost = "127.0.0.1"\n{servers}{options}'


def processes(person: Person) -> list[int]:
    return [int(handle["process"]) for handle in handles(person)]


@pytest.mark.parametrize("cluster", EACH_KIND, indirect=True)
def test_resident_servers_serve_one_client_after_the_other(person: Person, cluster: Path) -> None:
    alone = drawn(person, "--single")
    up = person.runs("deploy", "up", str(cluster))
    assert up.returncode == 0, up.stderr
    first = processes(person)
    for _ in range(2):
        assert drawn(person, "--cluster", str(cluster)) == alone
    assert person.runs("deploy", "up", str(cluster)).returncode == 0
    assert processes(person) == first, "up again started what was running"
    status = person.runs("deploy", "status", str(cluster))
    assert status.returncode == 0 and status.stdout.count("running") == 3
    assert person.runs("deploy", "logs", str(cluster)).returncode == 0
    assert person.runs("deploy", "down", str(cluster)).returncode == 0
    wait_until(lambda: not any(map(psutil.pid_exists, first)), "ended")


def test_a_server_that_was_killed_is_told_and_started_anew(person: Person, cluster: Path) -> None:
    assert person.runs("deploy", "up", str(cluster)).returncode == 0
    before = processes(person)
    os.kill(before[1], signal.SIGKILL)
    wait_until(lambda: "ended" in person.runs("deploy", "status", str(cluster)).stdout, "noticed")
    assert person.runs("deploy", "status", str(cluster)).returncode == 1
    assert drawn(person, "--cluster", str(cluster)) == drawn(person, "--single")
    after = processes(person)
    assert len(set(before) & set(after)) == 2


@pytest.mark.parametrize(
    ("cluster", "harm"), [("local", signal.SIGSTOP), ("ssh, waiting", signal.SIGKILL)], indirect=["cluster"]
)
def test_in_the_place_of_the_only_splat_server_another_is_started(
    person: Person, cluster: Path, harm: signal.Signals
) -> None:
    volume = person.folder / "head.nrrd"
    with SingleProcess(volume) as single, Session(volume, cluster=cluster) as session:
        scene = session.default_scene()
        expected = single.render(scene)
        assert torch.equal(session.render(scene), expected)
        before = processes(person)
        (splat,) = [
            psutil.Process(n) for n in before if "volsplat.splat_server" in " ".join(psutil.Process(n).cmdline())
        ]
        splat.send_signal(harm)
        wait_until(lambda: any(server.lost for server in session.servers), "is it noticed")
        assert torch.equal(session.render(scene), expected)
        assert splat.pid not in processes(person) and len(set(before) & set(processes(person))) == 2


@pytest.mark.parametrize("cluster", ["local"], indirect=True)
def test_a_session_that_ends_while_a_server_is_started_anew_leaves_nothing(person: Person, cluster: Path) -> None:
    said = list[str]()
    with Session(person.folder / "head.nrrd", cluster=cluster, on_progress=said.append) as session:
        session.default_scene()  # all have joined
        os.kill(processes(person)[1], signal.SIGKILL)
        wait_until(lambda: any("has ended" in line for line in said), "noticed")
    assert "is not up" in person.runs("deploy", "status", str(cluster)).stderr
    assert not servers_of(person)


def test_a_cluster_is_brought_up_for_one_picture_and_down_after_it(person: Person, cluster: Path) -> None:
    assert drawn(person, "--cluster", str(cluster)) == drawn(person, "--single")
    status = person.runs("deploy", "status", str(cluster))
    assert status.returncode == 2 and "is not up" in status.stderr


def test_several_sessions_in_turn_have_one_cluster_from_the_first_to_the_last(person: Person) -> None:
    path = cluster_file(person.folder, f"kept-{os.getpid()}", f"{LOCAL}map-shade-servers = 1\nsplat-servers = 1\n")
    with closing(KeptCluster(path, print, print)) as kept:
        begun: list[list[int]] = []
        for _ in range(2):
            with Session(person.folder / "head.nrrd", cluster=kept) as session:
                assert session.default_scene()
            begun.append(processes(person))
            with pytest.raises(BadInput, match="this process uses the cluster"):
                Session(person.folder / "head.nrrd", cluster=path)
        assert len(begun[0]) == 2 and begun[0] == begun[1]
    assert not servers_of(person)


def test_a_movie_of_several_volumes_brings_a_cluster_up_once(person: Person, monkeypatch: pytest.MonkeyPatch) -> None:
    path = cluster_file(person.folder, f"movie-{os.getpid()}", f"{LOCAL}map-shade-servers = 1\nsplat-servers = 1\n")
    shutil.copy(person.folder / "head.nrrd", person.folder / "again.nrrd")
    volumes = [str(person.folder / name) for name in ("head.nrrd", "again.nrrd")]
    ups: list[RunningCluster] = []
    up = RunningCluster.up

    def counted(cluster: RunningCluster, report: Callable[[str], None]) -> ClusterState:
        ups.append(cluster)
        return up(cluster, report)

    monkeypatch.setattr(RunningCluster, "up", counted)
    film = person.folder / "film"
    movie.main([*volumes, "-o", str(film), "--size", "16x16", "--cluster", str(path)], standalone_mode=False)
    assert len(ups) == 1 and len(list(film.iterdir())) == 2 and not servers_of(person)


FAILS = """
import sys
from volsplat.client import Session
try:
    Session("head.nrrd", cluster=sys.argv[1])
except Exception as error:
    print(error, flush=True)
sys.stdin.read()
"""


def test_a_client_that_comes_while_another_command_brings_a_cluster_up_leaves_it_alone(person: Person) -> None:
    path = cluster_file(person.folder, f"busy-{os.getpid()}", f"{LOCAL}map-shade-servers = 1\nsplat-servers = 1\n")
    pipe = subprocess.PIPE
    with RunningCluster(path).folder.locked():
        script = [sys.executable, "-c", FAILS, str(path)]
        client = subprocess.Popen(script, cwd=person.folder, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
        assert client.stdout is not None and "another command brings" in client.stdout.readline()
        examined = person.runs("deploy", "doctor", str(path))
        assert examined.returncode == 2 and examined.stderr.count("another command brings") == 1
    assert person.runs("deploy", "up", str(path)).returncode == 0
    try:
        assert client.communicate(timeout=PATIENCE) == ("", "")
        assert person.runs("deploy", "status", str(path)).returncode == 0 and len(servers_of(person)) == 2
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def test_servers_of_another_machine_with_the_same_home_are_left_to_it(person: Person, cluster: Path) -> None:
    assert person.runs("deploy", "up", str(cluster)).returncode == 0
    folder = RunningCluster(cluster).folder
    state = folder.load()
    assert state is not None and state.host == socket.gethostname()
    folder.save(msgspec.structs.replace(state, host="login2"))
    try:
        if "local" not in cluster.read_text(encoding="utf-8"):
            assert RunningCluster(cluster).state() is not None, "by ssh they are reached from everywhere"
            return
        for command in ("up", "down"):
            done = person.runs("deploy", command, str(cluster))
            assert done.returncode == 2 and "run on login2; use them there" in done.stderr
    finally:
        folder.save(state)


HOLDS = """import sys
from volsplat.client import Session
with Session("head.nrrd", cluster=sys.argv[1]) as session:
    session.default_scene()
    print("drawing", flush=True)
    sys.stdin.read()
"""


@contextmanager
def another_client(person: Person, cluster: Path) -> Iterator[subprocess.Popen[str]]:
    """A script that draws with the cluster until its input ends."""
    pipe = subprocess.PIPE
    script = [sys.executable, "-c", HOLDS, str(cluster)]
    with subprocess.Popen(script, cwd=person.folder, stdin=pipe, stdout=pipe, text=True) as client:
        assert client.stdout is not None and client.stdout.readline() == "drawing\n"
        yield client


@pytest.mark.parametrize("is_up", [True, False])
def test_a_second_client_waits_for_the_first_and_says_for_whom(person: Person, cluster: Path, is_up: bool) -> None:
    """Whether the cluster was up before, or is ended with the first client."""
    if is_up:
        assert person.runs("deploy", "up", str(cluster)).returncode == 0
    with another_client(person, cluster) as first:
        said: list[str] = []

        def hear(line: str) -> None:
            said.append(line)
            if f"waiting for -c (process {first.pid}, since " in line and first.stdin is not None:
                first.stdin.close()

        with Session(person.folder / "head.nrrd", cluster=cluster, on_progress=hear) as second:
            assert second.finish(second.default_scene()).complete
        assert any(line.startswith("waiting for -c") for line in said), said


def test_a_client_that_keeps_the_cluster_is_named_to_whoever_waited_long_enough(
    person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = cluster_file(person.folder, f"kept-{os.getpid()}", f"{LOCAL}map-shade-servers = 1\nsplat-servers = 1\n")
    monkeypatch.setattr(cluster_use, "PATIENCE_SECONDS", 0.0)
    with another_client(person, path) as first:
        with pytest.raises(BadInput, match=rf"serves -c \(process {first.pid}, since .*\); end that one, or try again"):
            Session(person.folder / "head.nrrd", cluster=path)
        with pytest.raises(BadInput, match=rf"serves -c \(process {first.pid}, since "):
            Doctor(path, None, Size(64, 64), lambda finding: None, print).examine()
        first.kill()
    try:
        with Session(person.folder / "head.nrrd", cluster=path) as own:
            with pytest.raises(BadInput, match="this process uses the cluster .* already, since .*; close that first"):
                Session(person.folder / "head.nrrd", cluster=path)
            assert own.finish(own.default_scene()).complete
        for _ in range(2):
            with pytest.raises(BadInput, match="no such folder|No such file or directory"):
                Session(person.folder / "head.nrrd", cluster=path, trace=person.folder / "absent" / "trace.json")
        with Session(person.folder / "head.nrrd", cluster=path) as again:
            again.default_scene()
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def test_a_client_dials_one_server_first_so_that_no_two_clients_wait_for_each_other(person: Person) -> None:
    waits = f'{LOCAL}listen = "127.0.0.1:{free_port()}"\nmap-shade-servers = 1\nsplat-servers = 1\n'
    path = cluster_file(person.folder, f"turns-{os.getpid()}", waits)
    assert person.runs("deploy", "up", str(path)).returncode == 0
    try:
        running, said = RunningCluster(path), list[str]()
        state, accepter = running.state(), Accepter(Role.CLIENT, running.token)
        assert state is not None
        first, second = sorted(one.wait_at for one in state.servers)

        def taken(address: str) -> Connection:
            place = parse_address(address)
            connection = call(place, "it", accepter, patience=PATIENCE, report=print, given_up=lambda: False)
            connection.send(DescribeMachine())
            assert connection.receive() is not None  # one that has let in two hangs up on one of them
            return connection

        held = taken(first)
        taken(second).close()
        with Session(person.folder / "head.nrrd", cluster=path, on_progress=said.append) as session:
            wait_until(lambda: any("serves another client" in line for line in said), "told")
            taken(second).close()  # the session has not
            held.close()
            assert session.finish(session.default_scene()).complete
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


@pytest.mark.parametrize("cluster", ["local, waiting"], indirect=True)
def test_a_session_that_has_failed_looks_for_no_more_servers(person: Person, cluster: Path) -> None:
    with Session(person.folder / "no.nrrd", cluster=cluster) as session:
        with pytest.raises(VolsplatError, match="no.nrrd"):
            session.default_scene()
        assert any(map(looks_for_servers, threading.enumerate()))  # each call lasts as long as its connection
        for server in processes(person):
            os.kill(server, signal.SIGKILL)
        wait_until(lambda: not any(map(looks_for_servers, threading.enumerate())), "does it leave them alone")


def looks_for_servers(thread: threading.Thread) -> bool:
    return thread.name.startswith("call ") or thread.name == "watch the cluster"


@pytest.mark.parametrize("speaks", [True, False])
def test_a_server_that_hangs_up_without_a_word_decides_nothing_at_first(
    speaks: bool, person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one does that two clients dial at the same moment."""
    monkeypatch.setattr(cluster_calls, "PAUSE_SECONDS", 0.05)
    path = cluster_file(person.folder, "same-moment", by_hand())
    assert person.runs("deploy", "up", str(path)).returncode == 0
    running, hello = RunningCluster(path), new_hello(Role.MAPSHADE_SERVER)
    state = running.state()
    assert state is not None
    addresses = map(parse_address, sorted(one.wait_at for one in state.servers))
    first, second = (WaitingPort(Role.MAPSHADE_SERVER, address, running.token) for address in addresses)
    with closing(first), closing(second), Session(person.folder / "head.nrrd", cluster=path):
        for _ in range(cluster_calls.MOST_WORDLESS - 1):
            first.next_client(hello, PATIENCE).close()
        with first.next_client(hello, PATIENCE) as client:
            with pytest.raises(PeerLost, match="no client"):
                second.next_client(hello, 0)
            while speaks and not ((asked := client.receive()) and isinstance(asked.message, DescribeMachine)):
                assert asked is not None
            if speaks:
                client.send(MachineDescribed(memory_bytes=1, threads=1))
                second.next_client(hello, PATIENCE).close()
        second.next_client(hello, PATIENCE).close()
    assert person.runs("deploy", "down", str(path)).returncode == 0


def test_a_client_that_is_killed_leaves_servers_for_the_next_one(person: Person, cluster: Path) -> None:
    assert person.runs("deploy", "up", str(cluster)).returncode == 0
    before = processes(person)
    script = "import os, sys; from volsplat.client import Session; s = Session('head.nrrd', cluster=sys.argv[1]); "
    script += "s.finish(s.default_scene()); os.kill(os.getpid(), 9)"
    client = subprocess.run([sys.executable, "-c", script, str(cluster)], cwd=person.folder, timeout=PATIENCE)
    assert client.returncode == -signal.SIGKILL
    assert drawn(person, "--cluster", str(cluster)) == drawn(person, "--single")
    assert processes(person) == before


def test_a_script_that_never_closes_its_session_leaves_no_server(person: Person, cluster: Path) -> None:
    script = "import sys; from volsplat.client import Session; s = Session('head.nrrd', cluster=sys.argv[1]); "
    script += "s.finish(s.default_scene())"
    asked = [sys.executable, "-c", script, str(cluster)]
    done = subprocess.run(asked, cwd=person.folder, timeout=PATIENCE, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr
    assert not servers_of(person)
    assert "is not up" in person.runs("deploy", "status", str(cluster)).stderr


def test_a_file_that_has_changed_since_is_told(person: Person) -> None:
    path = cluster_file(person.folder, "changed", LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n")
    assert person.runs("deploy", "up", str(path)).returncode == 0
    try:
        path.write_text(path.read_text(encoding="utf-8") + "\n# another\n")
        said = person.runs("render", "head.nrrd", "-o", "x.png", "--cluster", str(path))
        assert said.returncode == 2 and "has changed since" in said.stderr and said.stderr.count("\n") == 1
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def test_a_disk_that_is_full_is_told_and_leaves_no_server(person: Person, small_disk: Path) -> None:
    """Also if it fills up once servers are being started, which nobody could find again."""
    (person.folder / "state").symlink_to(small_disk)
    path = cluster_file(person.folder, "full", LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n")

    with pytest.raises(BadInput, match=r"state.json cannot be written: No space left on device; make room there"):
        RunningCluster(path).up(lambda line: fill(small_disk))
    assert not servers_of(person)
    (small_disk / "filler").unlink()
    RunningCluster(path).down(print)
    fill(small_disk)
    told = person.runs("deploy", "up", str(path))
    assert told.returncode == 2 and "No space left on device" in told.stderr and told.stderr.count("\n") == 1


@pytest.mark.parametrize("at_last", [True, False])
def test_servers_that_cannot_be_remembered_are_none_to_draw_with(
    person: Person, monkeypatch: pytest.MonkeyPatch, at_last: bool
) -> None:
    """Whether it fails once a machine's servers are there, or those of all."""
    path = cluster_file(person.folder, "unsaved", LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n")
    save = StateFolder.save

    def failing(folder: StateFolder, state: ClusterState) -> None:
        if state.servers and (threading.current_thread() is threading.main_thread()) == at_last:
            raise BadInput("the state cannot be written")
        save(folder, state)

    monkeypatch.setattr(StateFolder, "save", failing)
    with pytest.raises(BadInput, match="the state cannot be written"):
        KeptCluster(path, print, print)
    assert not servers_of(person)


def test_ctrl_c_as_soon_as_servers_are_there_leaves_none(person: Person, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before the thread that it interrupts has taken note of them."""
    path = cluster_file(person.folder, "interrupted", LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n")
    save = StateFolder.save

    def interrupted(folder: StateFolder, state: ClusterState) -> None:
        if state.servers and threading.current_thread() is threading.main_thread():
            assert servers_of(person)
            raise KeyboardInterrupt
        save(folder, state)

    monkeypatch.setattr(StateFolder, "save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Session(None, cluster=path)
    assert not servers_of(person)
    assert RunningCluster(path).state() is None


def test_the_state_is_its_owner_s_alone_and_holds_no_secret_where_others_look(person: Person) -> None:
    path = cluster_file(person.folder, "secret", LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n")
    assert person.runs("deploy", "up", str(path)).returncode == 0
    try:
        (folder,) = (person.folder / "state").glob("volsplat/clusters/secret")
        token = (folder / "token").read_text(encoding="utf-8").strip()
        assert folder.stat().st_mode & 0o777 == 0o700
        for place in (person.folder / "state").rglob("*"):
            if place.is_file():
                assert place.stat().st_mode & 0o077 == 0 and (place.name == "token") == (
                    token in place.read_text(encoding="utf-8")
                )
        for process in processes(person):
            assert token not in " ".join(psutil.Process(process).cmdline())
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def test_a_host_that_ssh_cannot_reach_is_named_with_ssh_s_reason(person: Person) -> None:
    path = cluster_file(person.folder, "nowhere", unreached("map-shade-servers = 1\nsplat-servers = 1\n"))
    said = person.runs("deploy", "up", str(path))
    assert said.returncode == 2 and "127.0.0.1: ssh: connect to host 127.0.0.1" in said.stderr


def test_what_could_not_be_started_is_named_and_not_waited_for(person: Person) -> None:
    whole = LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n"
    path = str(cluster_file(person.folder, "in-part", whole, unreached("map-shade-servers = 1\n")))
    try:
        up = person.runs("deploy", "up", path)
        assert up.returncode == 2 and f"the other 2 servers are up, and used by --cluster {path}" in up.stderr
        status = person.runs("deploy", "status", path)
        assert status.returncode == 1 and "127.0.0.1: 1 of 1 servers could not be started" in status.stderr
        doctor = person.runs("deploy", "doctor", path)
        assert doctor.returncode == 2 and "WRONG 127.0.0.1: start: 1 of 1 servers" in doctor.stdout
        alone = drawn(person, "--single")
        for again in (f"1 of 1 servers could not be started; try again: volsplat deploy up {path}", "ssh: connect to"):
            image = person.folder / "in-part.png"
            ran = person.runs("render", "head.nrrd", "-o", str(image), "--size", "48x48", "--cluster", path)
            assert ran.returncode == 0 and image.read_bytes() == alone
            assert f"note: 127.0.0.1: {again}" in ran.stderr and "servers are up" not in ran.stderr
            person.runs("deploy", "down", path)  # the second time the command itself brings it up
    finally:
        person.runs("deploy", "down", path)


def test_while_servers_are_started_none_is_said_to_have_failed(person: Person) -> None:
    path = cluster_file(person.folder, "in-part", LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n")
    running = RunningCluster(path)
    status = person.runs("deploy", "status", str(path))
    assert status.returncode == 2 and "is not up; run: volsplat deploy up" in status.stderr
    state = running.up(lambda line: None)
    try:
        with running.folder.locked():
            for servers, expected in (((), 1), (state.servers[:1], 1), (state.servers, 0)):
                begun = msgspec.structs.replace(state, servers=servers)
                running.folder.save(begun)
                status = person.runs("deploy", "status", str(path))
                assert status.returncode == expected and running.never_started(begun) == []
                assert status.stderr.strip() == "another command brings in-part up or down now"
        assert running.never_started(msgspec.structs.replace(state, servers=())) != []
    finally:
        running.down(lambda line: None)


def test_where_servers_cannot_be_asked_the_status_is_1_as_long_as_they_are_started(person: Person) -> None:
    waits = 'launcher = "manual"\nmap-shade-servers = 1\nsplat-servers = 1\nlisten = "127.0.0.1:1"\n'
    path = cluster_file(person.folder, "by-hand", waits)
    running = RunningCluster(path)
    running.up(lambda line: None)
    assert person.runs("deploy", "status", str(path)).returncode == 0
    with running.folder.locked():
        assert person.runs("deploy", "status", str(path)).returncode == 1
    said = list[str]()
    running.down(said.append)
    assert said == [
        "manual: 2 servers go on: end them on the other machine, by hand; without a client they end by themselves"
    ]


def test_a_server_is_started_anew_without_what_could_not_be_started(person: Person) -> None:
    whole = LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n"
    path = cluster_file(person.folder, "in-part", whole, unreached("map-shade-servers = 1\n"))
    volume, said = person.folder / "head.nrrd", list[str]()
    try:
        assert person.runs("deploy", "up", str(path)).returncode == 2
        with SingleProcess(volume) as single, Session(volume, cluster=path, on_progress=said.append) as session:
            scene = session.default_scene()
            before = processes(person)
            os.kill(before[0], signal.SIGKILL)
            wait_until(lambda: len(set(processes(person)) - set(before)) == 1, "started anew")
            wait_until(lambda: [one.lost for one in session.servers].count(False) == 2 < len(session.servers), "joined")
            assert torch.equal(session.render(scene), single.render(scene))
        assert not any("connect to host" in line for line in said), said
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


@pytest.mark.parametrize("left", ["nothing", "one kind"])
def test_where_a_kind_of_server_could_not_be_started_a_client_is_told_why(person: Person, left: str) -> None:
    kinds = ["map-shade-servers = 1\n", "splat-servers = 1\n"]
    broken = unreached("".join(kinds[left == "one kind" :]))
    machines = [broken, LOCAL + kinds[0]] if left == "one kind" else [broken]
    path = str(cluster_file(person.folder, "broken", *machines))
    try:
        assert person.runs("deploy", "up", path).returncode == 2
        told = person.runs("render", "head.nrrd", "-o", "image.png", "--cluster", path)
        assert told.returncode == 2 and "127.0.0.1: ssh: connect to host 127.0.0.1" in told.stderr
        logs = person.runs("deploy", "logs", path)
        assert logs.returncode == (0 if left == "one kind" else 2) and "None" not in logs.stderr
    finally:
        assert person.runs("deploy", "down", path).returncode == 0


@pytest.mark.parametrize("who_dials", ["", 'listen = "[::]:{port}"\n'], ids=["they dial", "they wait"])
def test_a_machine_that_only_ipv6_reaches_draws_beside_another(person: Person, who_dials: str) -> None:
    """Each has a splat server, so that packets go both ways."""
    each = f'data-root = "{person.folder}"\nthreads = 1\nmap-shade-servers = 1\nsplat-servers = 1\n'
    with sshd(person.folder / "six", address="::1") as six, sshd(person.folder / "four") as four:
        machines = [each + who_dials.format(port=free_port()) + six, each + four]
        path = str(cluster_file(person.folder, f"six-{os.getpid()}", *machines))
        try:
            said = person.runs("deploy", "doctor", path, "head.nrrd")
            assert said.returncode == 0, said.stdout + said.stderr
            assert drawn(person, "--cluster", path) == drawn(person, "--single")
        finally:
            assert person.runs("deploy", "down", path).returncode == 0


def test_a_port_that_a_tunnel_does_not_get_is_named(person: Person) -> None:
    """The client and its sshd are one machine here, so that the client itself has taken the port."""
    with sshd(person.folder / "sshd") as machine:
        keys = "map-shade-servers = 1\nsplat-servers = 1\n" + machine.replace("ssh = {", "ssh = {tunnel = true, ")
        path = cluster_file(person.folder, f"taken-{os.getpid()}", keys)
        said = person.runs("deploy", "doctor", str(path))
        (line,) = (line for line in said.stdout.splitlines() if "tunnel: " in line)
        assert said.returncode == 2 and line.startswith("WRONG") and "is taken" in line
        (state,) = (person.folder / "state").glob("volsplat/clusters/*")
        assert not (state / "state.json").exists(), "the servers are down again"


def test_servers_log_and_hand_out_metrics_as_the_file_says(person: Person) -> None:
    port, token = free_port(), person.folder / "scrape"
    metrics = f'metrics = "127.0.0.1:{port}"\nmetrics-token = "{token}"\n'
    path = cluster_file(person.folder, "told", LOCAL + metrics + "map-shade-servers = 1\nsplat-servers = 1\n")
    path.write_text(f'log-format = "json"\n{path.read_text(encoding="utf-8")}')
    assert person.runs("deploy", "up", str(path)).returncode == 0
    try:
        drawn(person, "--cluster", str(path))
        for number, counted in enumerate(("volsplat_frame_seconds", "volsplat_packets")):
            asked = urllib.request.Request(f"http://127.0.0.1:{port + number}/metrics")
            asked.add_header("Authorization", f"Bearer {token.read_text(encoding='utf-8').strip()}")
            with urllib.request.urlopen(asked, timeout=PATIENCE) as answer:
                assert counted in answer.read().decode()
        lines = [line.partition(": ")[2] for line in person.runs("deploy", "logs", str(path)).stdout.splitlines()]
        assert {msgspec.json.decode(line)["program"] for line in lines} == {"splat-server", "mapshade-server"}
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def test_servers_end_by_themselves_when_no_client_comes(person: Person) -> None:
    path = cluster_file(person.folder, "brief", LOCAL + "map-shade-servers = 1\nsplat-servers = 1\n", keep=1)
    assert person.runs("deploy", "up", str(path)).returncode == 0
    wait_until(lambda: not any(map(psutil.pid_exists, processes(person))), "ended")
    assert person.runs("deploy", "down", str(path)).returncode == 0


def test_lines_to_type_by_hand_start_servers_that_join(person: Person) -> None:
    path = cluster_file(person.folder, "by-hand", by_hand())
    up = person.runs("deploy", "up", str(path))
    lines = [line for line in up.stderr.splitlines() if line.startswith("volsplat ")]
    assert up.returncode == 0 and len(lines) == 2
    token = person.folder / "state" / "volsplat" / "clusters" / "by-hand" / "token"
    typed = [person.starts(*shlex.split(line)[1:-1], str(token)) for line in lines]
    try:
        drawn(person, "--cluster", str(path))
    finally:
        for program in typed:
            program.terminate()
            program.communicate(timeout=PATIENCE)
        person.runs("deploy", "down", str(path))


def test_who_is_missing_is_named_with_the_reason(person: Person, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_watch, "MISSING_SECONDS", 1.0)
    path = cluster_file(person.folder, "nobody", by_hand())
    assert person.runs("deploy", "up", str(path)).returncode == 0
    with Session(person.folder / "head.nrrd", cluster=path) as session:
        with pytest.raises(PeerLost, match="servers of nobody are missing: .* nobody listens there"):
            session.default_scene()
    person.runs("deploy", "down", str(path))


def both_kinds_and(ssh: str) -> tuple[str, str]:
    """Machines: this one, which can draw by itself, and one more map/shade server that ssh reaches."""
    return f"{LOCAL}map-shade-servers = 1\nsplat-servers = 1\n", f"{ssh}map-shade-servers = 1\n"


def test_the_others_draw_without_a_machine_that_nothing_is_heard_of(
    person: Person, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_watch, "UNHEARD_SECONDS", 0.1)
    with sshd(tmp_path / "gone") as ssh:
        path = cluster_file(person.folder, f"gone-{os.getpid()}", *both_kinds_and(ssh))
        assert person.runs("deploy", "up", str(path)).returncode == 0
    psutil.Process(int(handles(person)[-1]["process"])).suspend()  # and its machine's sshd is gone
    said = list[str]()
    try:
        with Session(person.folder / "head.nrrd", cluster=path, on_progress=said.append) as session:
            assert session.finish(session.default_scene()).complete
            assert any("ssh" in line and line.endswith("; the others draw without") for line in said)
    finally:
        psutil.Process(int(handles(person)[-1]["process"])).kill()
        person.runs("deploy", "down", str(path))


LEAVES_OPEN = """
import os, pathlib, signal, sys, time
from volsplat.client import Session
from volsplat.deploy.launchers import ssh
cluster, process, hangs, asked = sys.argv[1:]
ssh.SSH_SECONDS = 1e6
session = Session(os.path.abspath("head.nrrd"), cluster=cluster)
session.default_scene()
pathlib.Path(hangs).touch()
os.kill(int(process), signal.SIGKILL)
while not os.path.lexists(asked):
    time.sleep(0.01)
"""


def test_a_script_ends_at_once_though_a_machine_that_its_session_asks_hangs(
    person: Person, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, asked, program = tmp_path / "hangs", tmp_path / "asked", tmp_path / "bin" / "ssh"
    program.parent.mkdir()
    program.write_text(
        f"#!/bin/sh\n[ ! -e {hangs} ] || {{ ln -s $$ {asked}; exec sleep {2 * PATIENCE}; }}\n"
        f'exec {shutil.which("ssh")} "$@"\n',
        encoding="utf-8",
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    with sshd(tmp_path / "asked-there") as ssh:
        path = cluster_file(person.folder, f"hangs-{os.getpid()}", *both_kinds_and(ssh))
        assert person.runs("deploy", "up", str(path)).returncode == 0
        try:
            words = [str(path), handles(person)[-1]["process"], str(hangs), str(asked)]
            script = [sys.executable, "-c", LEAVES_OPEN, *words]
            assert subprocess.run(script, cwd=person.folder, timeout=PATIENCE).returncode == 0
            hanging = int(os.readlink(asked))
            wait_until(lambda: not psutil.pid_exists(hanging), "ended")
        finally:
            hangs.unlink(missing_ok=True)
            assert person.runs("deploy", "down", str(path)).returncode == 0


def test_the_others_draw_without_a_server_that_runs_and_does_not_dial(
    person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_watch, "JOINING_SECONDS", 0.1)
    path = cluster_file(person.folder, f"frozen-{os.getpid()}", f"{LOCAL}map-shade-servers = 2\nsplat-servers = 1\n")
    assert person.runs("deploy", "up", str(path)).returncode == 0
    frozen = next(one for one in servers_of(person) if is_server(one, "mapshade_server"))
    frozen.suspend()
    said = list[str]()
    try:
        with Session(person.folder / "head.nrrd", cluster=path, on_progress=said.append) as session:
            assert session.finish(session.default_scene()).complete
            assert any(line.endswith("has not joined yet; the others draw without") for line in said), said
            frozen.resume()
            wait_until(
                lambda: sum(bool(one.boxes) for one in session.servers) == 2, "the one that was frozen has a part"
            )
    finally:
        frozen.resume()
        person.runs("deploy", "down", str(path))


def test_the_others_draw_without_a_server_that_ends_each_time_that_it_is_started(
    person: Person, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_watch, "LOOK_SECONDS", 0.1)
    command = tmp_path / "volsplat"
    command.write_text("#!/bin/sh\necho no libraries here\n", encoding="utf-8")
    command.chmod(0o755)
    with sshd(tmp_path / "unable") as ssh:
        unable = re.sub(r'command = ".*"', f'command = "{command}"', ssh)
        path = cluster_file(person.folder, f"unable-{os.getpid()}", *both_kinds_and(unable))
        assert person.runs("deploy", "up", str(path)).returncode == 0
        said = list[str]()
        try:
            with Session(person.folder / "head.nrrd", cluster=path, on_progress=said.append) as session:
                assert session.finish(session.default_scene()).complete
                assert any("has ended: no libraries here; the others" in line for line in said), said
        finally:
            assert person.runs("deploy", "down", str(path)).returncode == 0


@pytest.mark.parametrize("what", ["statuses", "up_anew"])
def test_whatever_a_launcher_raises_a_lost_server_is_started_anew_after_it(
    what: str, person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_watch, "LOOK_SECONDS", 0.1)
    path = cluster_file(person.folder, f"raises-{os.getpid()}", f"{LOCAL}map-shade-servers = 1\nsplat-servers = 1\n")
    does, said, raised = getattr(RunningCluster, what), list[str](), list[str]()

    def does_at_last(running: RunningCluster, *given: object) -> object:
        if len(raised) < 2:
            raised.append(what)
            raise ValueError("not\nexpected")
        return does(running, *given)

    with Session(person.folder / "head.nrrd", cluster=path, on_progress=said.append) as session:
        session.default_scene()
        before = processes(person)
        monkeypatch.setattr(RunningCluster, what, does_at_last)
        os.kill(before[0], signal.SIGKILL)
        wait_until(lambda: len(set(processes(person)) - set(before)) == 1, "started anew")
    assert sum("ValueError: not expected" in line for line in said) == 1, said


def test_a_data_root_that_is_not_there_is_told_as_the_servers_are_started(person: Person) -> None:
    root = person.folder / "it's not there"
    path = cluster_file(
        person.folder, "no-root", f'{LOCAL}splat-servers = 1\nmap-shade-servers = 1\ndata-root = "{root}"\n'
    )
    up = person.runs("deploy", "up", str(path))
    assert up.returncode == 2 and f"data-root {root} is no folder there" in up.stderr
    assert servers_of(person) == []


def test_silence_of_a_cluster_file_is_that_of_its_servers_and_clients(person: Person) -> None:
    path = cluster_file(person.folder, f"silent-{os.getpid()}", f"{LOCAL}map-shade-servers = 2\nsplat-servers = 1\n")
    path.write_text(f"silence = 1.25\n{path.read_text(encoding='utf-8')}", encoding="utf-8")
    assert person.runs("deploy", "up", str(path)).returncode == 0
    try:
        servers = [psutil.Process(process) for process in processes(person)]
        for server in servers:
            words = server.cmdline()
            assert words[words.index("--silence") + 1] == "1.25"
        with Session(person.folder / "head.nrrd", cluster=path) as session:
            session.finish(session.default_scene())
            servers[1].suspend()
            wait_until(lambda: any("has said nothing for 1.25 s" in one.cause for one in session.servers), "noticed")
            servers[1].resume()
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0
