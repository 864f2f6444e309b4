"""What a machine's shell is asked, and what it answers, whatever names and logs hold."""

import os
import subprocess
from functools import partial
from pathlib import Path

import pytest

from support.patience import wait_until
from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers import local, ssh
from volsplat.deploy.launchers.launcher import Said, Secrets, ServerOrder, ServerState, StartedServer
from volsplat.deploy.launchers.shell import Run, ShellServers
from volsplat.deploy.server_command import Program
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.tokens import new_token

NODE = Machine(launcher="ssh", host="node", map_shade_servers=1)
SECRETS = Secrets(new_token(), Path("token"))
ODD = r"it's \new \\ $HOME `x` %s"


@pytest.fixture
def servers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ShellServers:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    (tmp_path / ODD).mkdir()
    return ShellServers(by_shell, by_shell, "here", "lab", lambda program: "true")


def by_shell(script: str, given: str) -> str:
    ran = subprocess.run(["sh", "-c", script], input=given, capture_output=True, encoding="utf-8")
    if ran.returncode:
        raise BadInput(ran.stdout)
    return ran.stdout


def stands_in_for_ssh(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that runs here what ssh is to run there."""
    program = folder / "ssh"
    program.write_text('#!/bin/sh\nwhile [ $# -gt 1 ]; do shift; done\neval "$1"\n', encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


def started(servers: ShellServers, data_root: str, command: str = "true") -> str:
    """The log of a server of this data-root, once it has ended."""
    order = ServerOrder("node map/shade", Program.MAPSHADE_SERVER, ("--data-root", data_root))
    each = servers._replace(command=lambda program: command).start([order], SECRETS, print)
    wait_until(lambda: servers.states(each)[order.name].state is ServerState.ENDED, "ended")
    return servers.states(each)[order.name].reason


@pytest.mark.parametrize("root", ["~", "~/", f"~/{ODD}", "~nobody/of/this/name", "/", "."])
def test_a_data_root_may_be_of_someone_s_home(servers: ShellServers, root: str) -> None:
    assert started(servers, root) == "without a word"


@pytest.mark.parametrize("root", ["~/missing", f"~/{ODD}/missing", f"/{ODD}", "./~"])
def test_a_data_root_that_is_not_there_is_named_as_it_was_given(servers: ShellServers, root: str) -> None:
    with pytest.raises(BadInput) as told:
        started(servers, root)
    assert str(told.value) == f"data-root {root} is no folder there; make it, or name another\n"


def test_a_log_that_cannot_be_written_is_named_before_any_server_starts(servers: ShellServers, tmp_path: Path) -> None:
    logs = tmp_path / ".local" / "state" / "volsplat" / "servers" / "lab"
    (logs / "node-map-shade.log").mkdir(parents=True)
    with pytest.raises(BadInput, match=r"\.log cannot be written$"):
        started(servers, "/", f"touch {tmp_path}/began")
    assert not (tmp_path / "began").exists()


def test_the_log_of_the_server_before_is_kept(servers: ShellServers, tmp_path: Path) -> None:
    logs = tmp_path / ".local" / "state" / "volsplat" / "servers" / "lab"
    for word in ("first", "second", "third"):
        assert started(servers, "/", f"echo {word}").startswith(word)
    log = logs / "node-map-shade.log"
    assert log.read_text(encoding="utf-8").startswith("third")
    before = log.with_name(f"{log.name}.1")
    assert before.read_text(encoding="utf-8").startswith("second") and before.stat().st_mode & 0o077 == 0
    started(servers, "/", "true")
    started(servers, "/", "true")
    assert before.read_text(encoding="utf-8").startswith("third"), "one that says nothing replaces none"


@pytest.mark.parametrize("run", [partial(ssh.run_there, NODE), local._run], ids=["ssh", "here"])
def test_ctrl_c_on_the_terminal_does_not_reach_what_starts_servers(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is for this process, which waits for what it has begun, and remembers it."""
    stands_in_for_ssh(tmp_path, monkeypatch)
    assert int(run("cut -d ' ' -f 5 /proc/$$/stat", "")) != os.getpgrp()


def test_a_command_that_is_not_there_is_named(servers: ShellServers) -> None:
    with pytest.raises(BadInput, match=r"^no\\name is not there$"):
        started(servers, "/", r"'no\name'")


@pytest.mark.parametrize("command", ["'{home}/my env/volsplat' now", "~/'my env'/volsplat", "~/my\\ env/volsplat x"])
def test_a_command_may_lie_in_a_folder_with_a_space(servers: ShellServers, tmp_path: Path, command: str) -> None:
    program = tmp_path / "my env" / "volsplat"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho begun\n", encoding="utf-8")
    program.chmod(0o755)
    assert started(servers, "/", command.format(home=tmp_path)) == "begun"


def test_the_last_line_of_a_log_is_told_as_it_stands(servers: ShellServers) -> None:
    order = ServerOrder("node splat", Program.SPLAT_SERVER, (r"at C:\new", r"\c"))
    each = servers._replace(command=lambda program: "printf '%s %s\\n'").start([order], SECRETS, print)
    ended = Said(ServerState.ENDED, r"at C:\new \c")
    wait_until(lambda: servers.states(each) == {order.name: ended}, "told")


@pytest.mark.parametrize(
    ("last", "told"),
    [
        (b"10 %\r20 %\n", "10 % 20 %"),
        ("one\u2028two\n".encode(), "one two"),
        (b"Sch\xe4del.nrrd: no such file", "Sch\ufffddel.nrrd: no such file"),
        (b"\x0b\x0c\x1c\x85\n", ""),
    ],
)
@pytest.mark.parametrize("run", [partial(ssh.run_there, NODE), local._run], ids=["ssh", "here"])
def test_a_log_of_any_bytes_is_told_in_one_line_beside_the_others(
    run: Run, last: bytes, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stands_in_for_ssh(tmp_path, monkeypatch)
    log = tmp_path / "log"
    log.write_bytes(b"before\n" + last)
    servers = ShellServers(run, run, "here", "lab", str)
    each = [StartedServer(name, "here", {"process": "1", "began": "0", "log": str(log)}) for name in "ab"]
    said = servers.states(each)
    assert [said[name].state for name in "ab"] == [ServerState.ENDED] * 2
    assert told in said["b"].reason and len(said["b"].reason.splitlines()) == 1
    assert servers.logs(each[0], 1)


def test_a_shell_that_answers_something_else_tells_of_no_server() -> None:
    servers = ShellServers(by_shell, lambda script, given: "Welcome\n", "here", "lab", str)
    each = [StartedServer(name, "here", {"process": "1", "began": "0", "log": "log"}) for name in "ab"]
    assert {said.state for said in servers.states(each).values()} == {ServerState.UNKNOWN}
