"""`volsplat deploy doctor` over real servers and a real sshd: what is right, what is wrong, and the cure."""

import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from support.patience import PATIENCE
from support.programs.clusters import cluster_file, sshd
from support.programs.hand_started import free_port
from support.programs.programs import Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.deploy.cluster_file import read_cluster
from volsplat.deploy.doctor.forecast import Drawer, Size, drawn_level, forecast
from volsplat.deploy.doctor.way_in import way_in
from volsplat.deploy.server_command import Program
from volsplat.deploy.tunnels.ports import Way
from volsplat.deploy.tunnels.tunnel import Tunnel
from volsplat.protocol.description.volume import Geometry

BOTH = "map-shade-servers = 1\nsplat-servers = 1\n"
WORKER = "map-shade-servers = 1\n"


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for n, name in enumerate(("there", "elsewhere")):
        (tmp_path / name).mkdir()
        write_volume(tmp_path / name / "head.nrrd", *make_phantom("head", size=(16, 16, 16 + n)))
    return Person(tmp_path)


@pytest.fixture(scope="module")
def ssh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A machine that ssh reaches, as a cluster file has it."""
    with ExitStack() as ended:
        yield ended.enter_context(sshd(tmp_path_factory.mktemp("ssh") / "sshd")) + "threads = 1\n"


def looks(person: Person, *machines: str, volume: str | None = "head.nrrd") -> "subprocess.CompletedProcess[str]":
    path = cluster_file(person.folder, f"doctor-{os.getpid()}", *machines)
    return person.runs("deploy", "doctor", str(path), *([volume] if volume else []))


def wrong(person: Person, *machines: str) -> str:
    """What is said to be wrong."""
    said = looks(person, *machines)
    assert said.returncode == 2, said.stdout + said.stderr
    assert re.search(r"\d+ of \d+ hops are wrong", said.stderr)
    return "\n".join(line for line in said.stdout.splitlines() if line.startswith("WRONG"))


def test_each_hop_of_a_cluster_that_is_right_is_said_to_be_and_nothing_stays_behind(person: Person, ssh: str) -> None:
    said = looks(person, f'data-root = "{person.folder}/there"\nlisten = "127.0.0.1:{free_port()}"\n{BOTH}{ssh}')
    assert said.returncode == 0, said.stdout + said.stderr
    assert [line.split(": ")[1] for line in said.stdout.splitlines()[:-1]] == [
        *("name", "port", "ssh", "clock", "version"),
        *("link", "machine", "speed") * 2,
        *("volume", "packets", "forecast"),
    ]
    assert all(line.startswith("ok") for line in said.stdout.splitlines()[:-1])
    assert person.runs("deploy", "status", str(person.folder / "cluster.toml")).returncode == 2


def test_what_a_login_shell_prints_as_it_starts_is_passed_over(person: Person, tmp_path: Path) -> None:
    login = tmp_path / "login"
    login.write_text(
        "#!/bin/sh\nseq -f 'Welcome, line %g' 99\nprintf 'no end of line'\nprintf '\\377 not UTF-8' >&2\n"
        'exec sh -c "$SSH_ORIGINAL_COMMAND"\n'
    )
    login.chmod(0o755)
    banner = tmp_path / "banner"
    banner.write_text("Authorised users only\n")
    with sshd(tmp_path / "greeting", f"ForceCommand {login}", f"Banner {banner}") as ssh:
        machine = f'data-root = "{person.folder}/there"\nthreads = 1\n{BOTH}{ssh}'
        said = looks(person, machine)
        assert said.returncode == 0, said.stdout + said.stderr
        (there,) = read_cluster(person.folder / "cluster.toml").machines
        with closing(Tunnel(Way(there, (), ()), print)) as tunnel:
            assert tunnel.failure(PATIENCE) == ""
        path = str(person.folder / "cluster.toml")
        try:
            assert person.runs("deploy", "up", path).returncode == 0
            status = person.runs("deploy", "status", path)
            assert status.stdout.count("running") == 2, status.stdout + status.stderr
            assert "Welcome" not in person.runs("deploy", "logs", path).stdout
        finally:
            assert person.runs("deploy", "down", path).returncode == 0
        named = wrong(person, machine.replace("/volsplat", "/no-volsplat"))
        assert "no-volsplat is not there; give command" in named and "Welcome" not in named and "users" not in named


def test_a_command_in_a_folder_with_a_space_is_found(person: Person, ssh: str) -> None:
    (installed,) = re.findall('command = "(.*)"', ssh)
    (person.folder / "my env").symlink_to(Path(installed).parent)
    quoted = ssh.replace(f'"{installed}"', f"\"'{person.folder}/my env/volsplat'\"")
    (machine,) = read_cluster(cluster_file(person.folder, "spaces", BOTH + quoted)).machines
    assert [finding.line for finding in way_in(machine) if not finding.right] == []
    (missing,) = read_cluster(cluster_file(person.folder, "spaces", BOTH + quoted.replace("my env", "no env"))).machines
    (finding,) = (finding for finding in way_in(missing) if not finding.right)
    assert finding.line.startswith(f"{person.folder}/no env/volsplat is not there; give command")


def test_servers_that_are_up_are_asked_and_stay_up(person: Person) -> None:
    path = str(cluster_file(person.folder, f"doctor-{os.getpid()}", f'launcher = "local"\nthreads = 1\n{BOTH}'))
    volume = str(person.folder / "there" / "head.nrrd")
    assert person.runs("deploy", "up", path).returncode == 0
    try:
        for _ in range(2):
            said = person.runs("deploy", "doctor", path, volume)
            assert said.returncode == 0, said.stdout + said.stderr
        status = person.runs("deploy", "status", path)
        assert status.stdout.count("running") == 2, status.stdout
    finally:
        assert person.runs("deploy", "down", path).returncode == 0


def test_a_volume_that_differs_from_machine_to_machine_is_named(person: Person, ssh: str) -> None:
    local = f'launcher = "local"\nthreads = 1\ndata-root = "{person.folder}/there"\n{BOTH}'
    lines = wrong(person, local, f'data-root = "{person.folder}/elsewhere"\n{WORKER}{ssh}')
    assert re.fullmatch(r"WRONG 127.0.0.1 map/shade: volume: another one than local map/shade sees: .*; copy .*", lines)


def test_a_volume_that_is_not_there_is_named(person: Person, ssh: str) -> None:
    lines = wrong(person, f'data-root = "{person.folder}/state"\n{BOTH}{ssh}')
    assert "127.0.0.1 map/shade: volume: " in lines and "head.nrrd" in lines


def test_a_name_that_nobody_knows_and_a_port_where_nobody_listens_are_told_apart(person: Person, ssh: str) -> None:
    local = f'launcher = "local"\nthreads = 1\ndata-root = "{person.folder}/there"\n{BOTH}'
    unknown = f'{WORKER}launcher = "ssh"\nhost = "nowhere.invalid"\n'
    options = ["-F", "none", "-p", str(free_port())]
    refused = f'{WORKER}launcher = "ssh"\nhost = "localhost"\nssh.options = {options!r}\n'
    lines = wrong(person, local, unknown, refused)
    assert "nowhere.invalid: name: nowhere.invalid is unknown" in lines
    assert "localhost: port: " in lines and "nobody listens there" in lines


def test_another_version_and_no_volsplat_at_all_are_named(person: Person, ssh: str, tmp_path: Path) -> None:
    command = re.search(r'command = "(.*)"', ssh)
    assert command is not None
    other = tmp_path / "volsplat"
    other.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo "volsplat 0.0.1" && exit\nexec {command[1]} "$@"\n')
    other.chmod(0o755)
    told = f'data-root = "{person.folder}/there"\n{BOTH}' + ssh
    assert "version: volsplat 0.0.1 there" in wrong(person, told.replace(command[1], str(other)))
    assert "give command = " in wrong(person, told.replace(command[1], "/nowhere/volsplat"))


def test_servers_of_another_token_are_named(person: Person) -> None:
    machine = f'launcher = "local"\nthreads = 1\nlisten = "127.0.0.1:{free_port()}"\n{BOTH}'
    path = cluster_file(person.folder, f"token-{os.getpid()}", machine)
    assert person.runs("deploy", "up", str(path)).returncode == 0
    (token,) = (person.folder / "state").glob("volsplat/clusters/*/token")
    try:
        token.write_text("another-token-than-the-servers-know\n", encoding="utf-8")
        said = person.runs("deploy", "doctor", str(path))
        assert said.returncode == 2
        assert len(re.findall("WRONG .*: link: .*token", said.stdout)) == 2, said.stdout + said.stderr
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def images_a_second(*drawers: Drawer, side: int = 512) -> float:
    """If a tenth of the voxels shows."""
    line = forecast("lab", drawers, Geometry((512, 512, 512)), Size(side, side)).line
    assert line.startswith(f"{side} x {side}: ")
    return float(line.removeprefix(f"{side} x {side}: ").split()[0])


def test_more_servers_faster_links_and_smaller_images_are_forecast_to_be_faster() -> None:
    gigabit = 1e9
    worker, splat = (Drawer(program, 8, gigabit) for program in Program)
    lab = images_a_second(worker, splat)
    assert images_a_second(worker, worker, splat, splat) > lab
    assert images_a_second(worker, splat._replace(bits_per_second=gigabit / 100)) < lab / 10
    assert images_a_second(worker._replace(bits_per_second=None), splat._replace(bits_per_second=None)) > lab
    assert images_a_second(worker, splat, side=2048) < lab


def test_what_is_forecast_is_the_level_that_a_fit_draws() -> None:
    volume = Geometry((2048, 2048, 64), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 8.0)))
    half = Geometry((1024, 1024, 64), ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 8.0)))
    quarter = Geometry((512, 512, 64), ((4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, 0.0, 8.0)))
    drawn = [drawn_level((volume, half, quarter), Size(side, side)).dims for side in (2048, 768, 512, 64)]
    assert drawn == [volume.dims, half.dims, quarter.dims, quarter.dims]
    assert drawn_level((volume,), Size(64, 64)) == volume


def test_an_image_size_that_is_none_is_refused(person: Person) -> None:
    path = cluster_file(person.folder, "doctor-size", f'launcher = "local"\n{BOTH}')
    said = person.runs("deploy", "doctor", str(path), "--size", "large")
    assert said.returncode == 2 and said.stderr.startswith("volsplat: --size large: give WIDTHxHEIGHT"), said.stderr
