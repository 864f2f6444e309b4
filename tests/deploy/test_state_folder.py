"""The lock by which one command at a time changes a cluster."""

import errno
import fcntl
import pwd
import shlex
from pathlib import Path

import msgspec
import pytest

from support.programs.clusters import cluster_file
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import StateFolder
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.tokens import new_token


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StateFolder:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return StateFolder("lab")


def test_one_command_at_a_time_changes_a_cluster(folder: StateFolder) -> None:
    assert not folder.is_locked
    with folder.locked():
        assert folder.is_locked
        with pytest.raises(BadInput, match="another command brings lab up or down now"), folder.locked():
            pass
    assert not folder.is_locked
    with folder.locked():
        assert folder.is_locked


def test_nobody_is_refused_for_one_who_only_looks(folder: StateFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who looks whether it is locked at the very moment that a command begins to change it."""
    with folder.locked():
        pass
    looker = (folder.path / "lock").open("rb")
    flock, refused = fcntl.flock, list[int]()
    flock(looker, fcntl.LOCK_SH)

    def looked(descriptor: int, operation: int) -> None:
        try:
            flock(descriptor, operation)
        except BlockingIOError:
            refused.append(operation)
            looker.close()  # has seen enough
            raise

    monkeypatch.setattr(fcntl, "flock", looked)
    with folder.locked():
        assert refused == [fcntl.LOCK_EX | fcntl.LOCK_NB] and looker.closed
        assert folder.is_locked


def test_a_state_of_the_build_before_is_read(folder: StateFolder) -> None:
    """Which noted when a machine did not end by another clock, as a number."""
    server = {
        "started": {"name": "lab, process 1", "place": "lab", "handle": {}},
        "program": "volsplat.splat_server",
        "machine": 0,
    }
    state = {"file": "", "listen_port": 1, "servers": [server], "not_ended_since": {"0": 1e9}}
    with folder.locked():
        (folder.path / "state.json").write_bytes(msgspec.json.encode(state))
    read = folder.load()
    assert read is not None and len(read.servers) == 1


def test_a_home_without_locks_is_told_with_the_cure(folder: StateFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def without_locks(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", without_locks)
    with pytest.raises(BadInput, match=r"cannot be locked: No locks available; set XDG_STATE_HOME"), folder.locked():
        pass


def test_what_a_command_meets_while_it_changes_a_cluster_is_told_as_it_is(folder: StateFolder) -> None:
    with pytest.raises(BlockingIOError, match="of a socket"), folder.locked():
        raise BlockingIOError("of a socket")


BOTH_KINDS = "map-shade-servers = 1\nsplat-servers = 1\n"


def of_file(folder: Path, machine: str, *keys: str) -> RunningCluster:
    path = cluster_file(folder, "lab", f"{machine}\n{BOTH_KINDS}")
    path.write_text("".join(f"{key}\n" for key in keys) + path.read_text(encoding="utf-8"), encoding="utf-8")
    return RunningCluster(path)


def test_a_relative_token_file_lies_beside_the_cluster_file(
    folder: StateFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab, elsewhere, token = tmp_path / "lab", tmp_path / "elsewhere", new_token()
    lab.mkdir()
    elsewhere.mkdir()
    token.write(lab / "secret")
    cluster = of_file(lab, 'launcher = "local"', 'token-file = "secret"')
    assert cluster.token.key == token.key
    monkeypatch.chdir(elsewhere)
    assert cluster.token.key == token.key
    monkeypatch.chdir(tmp_path)
    assert RunningCluster(Path("lab/cluster.toml")).token.key == token.key


@pytest.mark.parametrize("keys", [(), ('token-file = "its secret"',)], ids=["own", "given"])
def test_lines_to_type_by_hand_name_the_token_that_is_there(
    folder: StateFolder, tmp_path: Path, keys: tuple[str, ...]
) -> None:
    new_token().write(tmp_path / "its secret")
    machine = 'launcher = "manual"\nlisten = "127.0.0.1:7000"'
    cluster, said = of_file(tmp_path, machine, *keys), list[str]()
    cluster.up(said.append)
    copied = Path(said[0].removeprefix("copy ").partition(" to the other machine")[0])
    assert copied.read_text(encoding="ascii").strip() == cluster.token.key.decode()
    for line in said[1:]:
        words = shlex.split(line)
        assert words[words.index("--token-file") + 1] == copied.name


def test_a_user_without_a_home_is_told_what_to_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(pwd, "getpwuid", {}.__getitem__)  # as in a container that runs as a number alone
    with pytest.raises(BadInput, match="home is not known; set HOME, or XDG_STATE_HOME"):
        of_file(tmp_path, 'launcher = "local"').up(print)


NOBODY_S = '"~nobody-of-this-name/x"'


@pytest.mark.parametrize(
    ("machine", "keys"),
    [
        ('launcher = "local"', [f"token-file = {NOBODY_S}"]),
        (f'launcher = "slurm"\nslurm.folder = {NOBODY_S}', ['client = "127.0.0.1:7000"']),
        (f'launcher = "dask"\ndask.scheduler-file = {NOBODY_S}', ['client = "127.0.0.1:7000"']),
    ],
    ids=["token", "slurm", "dask"],
)
def test_the_home_of_nobody_is_told_in_one_line(
    folder: StateFolder, tmp_path: Path, machine: str, keys: list[str]
) -> None:
    with pytest.raises(BadInput, match=r"^~nobody-of-this-name/x: no such user's home is known here; give"):
        of_file(tmp_path, machine, *keys).up(print)
