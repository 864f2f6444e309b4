"""Cells of a notebook that run again or are deleted, in a real kernel: what they showed ends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest
from jupyter_client.blocking.client import BlockingKernelClient
from jupyter_client.manager import start_new_kernel
from jupyter_client.provisioning.local_provisioner import LocalProvisioner

from support.patience import PATIENCE
from support.programs.programs import SERVERS
from support.programs.server_processes import is_server

OPENING = """
import numpy as np, volsplat as vs
volume = vs.Volume(np.arange(4096, dtype=np.uint16).reshape(16, 16, 16), spacing=(1, 1, 1))
"""
PLOT = "vs.plot(volume, size=20)\n"


@dataclass
class Notebook:
    """A kernel and who asks it to run cells."""

    asks: BlockingKernelClient
    process: psutil.Process

    def run(self, code: str, cell: str | None, deleted: Sequence[str] = ()) -> None:
        """As JupyterLab asks for it, or with None as a program that names no cells."""
        content = {"code": code, "silent": False, "store_history": True, "user_expressions": {}, "allow_stdin": False}
        named = {} if cell is None else {"cellId": cell, "deletedCells": list(deleted)}
        request = self.asks.session.msg("execute_request", content, metadata=named)
        self.asks.shell_channel.send(request)
        reply = self.asks._recv_reply(request["header"]["msg_id"], timeout=PATIENCE)
        assert reply["content"]["status"] == "ok", reply["content"]

    def servers(self) -> set[int]:
        """Numbers of the processes that were started by its cells and live."""
        return {
            process.pid
            for process in self.process.children(recursive=True)
            if any(is_server(process, program) for program in SERVERS)
        }


@pytest.fixture
def notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Notebook]:
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path))
    kernel, asks = start_new_kernel(startup_timeout=PATIENCE, cwd=str(tmp_path))
    try:
        assert isinstance(kernel.provisioner, LocalProvisioner) and kernel.provisioner.pid is not None
        opened = Notebook(asks, psutil.Process(kernel.provisioner.pid))
        opened.run(OPENING, "first")
        yield opened
    finally:
        asks.stop_channels()
        kernel.shutdown_kernel()


def test_a_cell_that_runs_again_or_is_deleted_ends_what_it_showed(notebook: Notebook) -> None:
    notebook.run(PLOT, "a")
    first = notebook.servers()
    notebook.run(PLOT, "b")
    second = notebook.servers() - first
    assert first and len(second) == len(first), "another cell shows another"

    notebook.run(PLOT + PLOT, "a")
    again = notebook.servers() - second
    assert len(again) == 2 * len(first) and again.isdisjoint(first), "one run of a cell may show several"
    assert second <= notebook.servers()

    notebook.run("1 + 1", "a")
    assert notebook.servers() == second, "it need not show anything again"
    notebook.run("1 + 1", "c", deleted=["a", "b"])
    assert not notebook.servers()


SHOW_AGAIN = """
session, shown = globals().get("session") or vs.open(volume, workers=1), globals().get("shown", [])
shown.append(vs.plot(session, size=20))
*earlier, last = [widget.comm is None for widget in shown]
assert all(earlier) and not last, "it is closed, and its drawing has ended"
"""


def test_of_a_session_that_a_cell_was_given_the_widget_alone_ends(notebook: Notebook) -> None:
    notebook.run(SHOW_AGAIN, "a")
    opened = notebook.servers()
    notebook.run(SHOW_AGAIN, "a")
    assert opened and notebook.servers() == opened


def test_where_cells_have_no_names_each_shows_on(notebook: Notebook) -> None:
    notebook.run(PLOT, None)
    first = notebook.servers()
    notebook.run(PLOT, None)
    assert first < notebook.servers()
