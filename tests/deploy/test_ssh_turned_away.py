"""An sshd that too many dial at once turns some away before they log in: they try again, and only they."""

import os
from pathlib import Path

import pytest

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launcher_keys import SshKeys
from volsplat.deploy.launchers import ssh
from volsplat.protocol.text.errors import BadInput

TURNED_AWAY = "kex_exchange_identification: read: Connection reset by peer"
NODE = Machine(launcher="ssh", host="node", map_shade_servers=1)


@pytest.fixture
def tries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Has a line for each try of an ssh that fails with the words in `words`, one line a try, and then gets in."""
    program = tmp_path / "ssh"
    program.write_text(
        f"""#!/bin/sh
cd {tmp_path}
echo try >> tries
words=$(sed -n "$(wc -l < tries)p" words)
[ -z "$words" ] || {{ echo "$words" >&2; exit 255; }}
while [ $# -gt 1 ]; do shift; done
eval "$1"
""",
        encoding="utf-8",
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(ssh, "FIRST_PAUSE_SECONDS", 0.01)
    return tmp_path / "tries"


def run(tries: Path, *words: str) -> str:
    tries.with_name("words").write_text("".join(f"{line}\n" for line in words), encoding="utf-8")
    return ssh.run_there(NODE, 'read -r given; echo "there: $given"', "a token\n")


def test_who_is_turned_away_tries_again_with_the_same_input(tries: Path) -> None:
    assert run(tries, TURNED_AWAY, TURNED_AWAY) == "there: a token\n"
    assert tries.read_text(encoding="utf-8").count("try") == 3


def test_who_is_never_let_in_says_why(tries: Path) -> None:
    with pytest.raises(BadInput, match=f"^node: {TURNED_AWAY}; try: ssh node$"):
        run(tries, *[TURNED_AWAY] * 9)
    assert tries.read_text(encoding="utf-8").count("try") == ssh.TRIES


def test_the_command_to_try_has_the_options_of_the_cluster_file(tries: Path) -> None:
    tries.with_name("words").write_text("Permission denied (publickey).\n", encoding="utf-8")
    node = Machine(launcher="ssh", host="node", ssh=SshKeys(options=("-p", "2222", "-i", "my key")))
    with pytest.raises(BadInput, match=r"; try: ssh -p 2222 -i 'my key' node$"):
        ssh.run_there(node, "true", "")


BY_A_JUMP_HOST = "; kex_exchange_identification: Connection closed by remote host"


@pytest.mark.parametrize(
    "words",
    [
        "Permission denied (publickey).",
        f"jump: Permission denied (publickey).{BY_A_JUMP_HOST}",
        f"Host key verification failed.{BY_A_JUMP_HOST}",
        f"ssh: Could not resolve hostname jump: Name or service not known{BY_A_JUMP_HOST}",
        f"ssh: connect to host jump port 22: Connection refused{BY_A_JUMP_HOST}",
        f"volsplat-begins; {TURNED_AWAY}",
    ],
)
def test_other_failures_are_told_at_once(tries: Path, words: str) -> None:
    with pytest.raises(BadInput, match="^node: "):
        run(tries, words)
    assert tries.read_text(encoding="utf-8").count("try") == 1
