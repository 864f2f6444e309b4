"""A tunnel that ends is dialled anew, whatever becomes of the ssh that is to let go of its ports."""

import os
from contextlib import closing
from pathlib import Path

import pytest

from support.patience import wait_until
from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.tunnels import tunnel
from volsplat.deploy.tunnels.ports import Way
from volsplat.deploy.tunnels.tunnel import Tunnel

NODE = Machine(launcher="ssh", host="node", map_shade_servers=1)


def test_an_ssh_that_hangs_while_ports_are_let_go_of_does_not_end_the_tunnel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first opens the tunnel and ends, the second hangs, those after it do as they are told."""
    program = tmp_path / "ssh"
    program.write_text(
        f"""#!/bin/sh
printf '%s\\n' "$*" >> {tmp_path}/calls
[ "$(wc -l < {tmp_path}/calls)" = 2 ] && exec sleep 1000
printf '\\n{tunnel.OPEN} 1 1\\n'
[ "$(wc -l < {tmp_path}/calls)" = 1 ] || exec cat
""",
        encoding="utf-8",
    )
    program.chmod(0o755)
    (tmp_path / "calls").touch()
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(tunnel, "OPEN_SECONDS", 1.0)
    monkeypatch.setattr(tunnel, "FIRST_PAUSE_SECONDS", 0.01)
    said = list[str]()
    with closing(Tunnel(Way(NODE, (), ()), said.append)):
        wait_until(lambda: len(calls(tmp_path)) > 2, "tried again")
        assert all("ServerAliveInterval" in call for call in calls(tmp_path))


def calls(folder: Path) -> list[str]:
    return (folder / "calls").read_text(encoding="utf-8").splitlines()
