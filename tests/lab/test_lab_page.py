"""docs/howto/lab.md, typed from top to bottom at a desk in a lab of four hosts in a box."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from support.checkout import ROOT
from support.lab.box import Box, box, why_no_box
from support.patience import PATIENCE, wait_until
from support.programs.programs import VOLSPLAT
from support.programs.server_processes import words_of
from volsplat.client import Session
from volsplat.client.session.single import SingleProcess
from volsplat.program.exit_status import EXIT_INTERRUPTED

WHY_NOT = why_no_box()
pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)

PAGE = (ROOT / "docs" / "howto" / "lab.md").read_text(encoding="utf-8")
NODES = ("node1", "node2", "node3")
NOT_RUN = ("make install", "pip wheel", "for node in")  # test_installation.py installs wheels


@dataclass(frozen=True)
class Desk:
    """Someone who types what the page says; `folder` stands for the disks of all hosts."""

    box: Box
    folder: Path

    def on(self, text: str) -> str:
        """As it is on these hosts, whose ssh has its configuration elsewhere, and volsplat its place."""
        text = text.replace("~/volsplat/bin/volsplat", str(VOLSPLAT)).replace("/scratch/volumes", f"{self.folder}/v")
        return text.replace('launcher = "ssh"', f'launcher = "ssh"\nssh.options = ["-F", "{self.box.ssh_config}"]')

    def words(self, line: str) -> list[str]:
        program, *rest = shlex.split(self.on(line))
        inside = self.box.hosts["desk"].inside
        if program == "volsplat":
            return [*inside, str(VOLSPLAT), *rest, *(["--size", "24"] if rest[0] == "phantom" else [])]
        return [*inside, program, "-F", str(self.box.ssh_config), *rest]

    def starts(self, line: str) -> subprocess.Popen[str]:
        environment = {**os.environ, "XDG_STATE_HOME": str(self.folder / "state")}
        piped = subprocess.PIPE
        return subprocess.Popen(
            self.words(line), cwd=self.folder, env=environment, stdout=piped, stderr=piped, encoding="utf-8"
        )

    def types(self, line: str) -> str:
        with self.starts(line) as typed:
            out, errors = typed.communicate(timeout=PATIENCE)
        assert typed.returncode == 0, f"{line}\n{out}{errors}"
        return out

    def views(self, line: str) -> None:
        """Until the page is there; Ctrl-C then ends it."""
        with self.starts(f"{line} --no-browser") as viewing:
            assert viewing.stderr is not None
            said = ""
            for text in viewing.stderr:
                said += text
                if "http://" in text:
                    viewing.send_signal(signal.SIGINT)
        assert viewing.returncode == EXIT_INTERRUPTED, said


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    (tmp_path / "v").mkdir()
    with box(tmp_path, ("desk", *NODES)) as made:
        yield Desk(made, tmp_path)


def typed_lines() -> list[str]:
    lines = re.findall(r"^ {4}(\S.*)$", PAGE, re.MULTILINE)
    return [line for line in lines if not line.startswith(NOT_RUN) and line != "done"]


def tables() -> list[str]:
    return re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_page_leads_from_bare_machines_to_a_picture(desk: Desk) -> None:
    (desk.folder / "lab.toml").write_text(desk.on(tables()[0]), encoding="utf-8")
    for line in typed_lines():
        if line.startswith("volsplat view"):
            desk.views(line)
        else:
            out = desk.types(line)
            assert "WRONG" not in out and (" doctor " not in line or out.count("volume: ") == len(NODES)), out
    assert (desk.folder / "head.png").stat().st_size
    wait_until(lambda: not any(map(desk.box.servers, NODES)), "without servers")


def test_where_only_ssh_gets_through_it_carries_everything(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    told, only_ssh = tables()
    file = told.replace('launcher = "ssh"\n', f'launcher = "ssh"\n{only_ssh}')
    (desk.folder / "lab.toml").write_text(desk.on(file), encoding="utf-8")
    desk.types("volsplat phantom head -o v/head.nrrd")
    for name in ("desk", *NODES):
        desk.box.let_only_ssh_through(name, jump="node1" if name == "node3" else None)
    findings = desk.types("volsplat deploy doctor lab.toml head.nrrd")
    assert findings.count("tunnel: carries") == len(NODES) and "WRONG" not in findings
    monkeypatch.setenv("XDG_STATE_HOME", str(desk.folder / "state"))
    said = list[str]()
    with Session("head.nrrd", cluster=desk.folder / "lab.toml", on_progress=said.append) as session:
        scene = session.default_scene()
        with SingleProcess(desk.folder / "v" / "head.nrrd") as single:
            expected = single.render(scene)
        assert session.render(scene).equal(expected)
        before = {name: desk.box.servers(name) for name in NODES}
        (tunnel,) = (ssh for ssh in tunnels() if "node2" in words_of(ssh))
        tunnel.kill()
        wait_until(lambda: "the tunnel to node2 is open again" in said, "open again")
        assert session.render(scene).equal(expected)
        wait_until(lambda: sum(not server.lost for server in session.servers) == len(NODES) + 1, "joined again")
        assert session.render(scene).equal(expected)
        assert {name: desk.box.servers(name) for name in NODES} == before, "what its tunnel held back was started anew"
    assert not tunnels()


def tunnels() -> list[psutil.Process]:
    """Those that this process has open."""
    return [one for one in psutil.Process().children() if "ExitOnForwardFailure=yes" in words_of(one)]
