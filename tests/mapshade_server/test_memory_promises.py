"""Servers of one machine do not count on the same memory, whatever becomes of them."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.patience import wait_until
from volsplat.mapshade_server.held import memory_budget
from volsplat.mapshade_server.held.memory_budget import MemoryBudget
from volsplat.mapshade_server.held.memory_promises import MemoryPromises
from volsplat.protocol.text.errors import NoRoom

MIB = 1 << 20
SERVER = """
import resource
import sys
import threading
from pathlib import Path
from volsplat.mapshade_server.held.memory_budget import MemoryBudget
from volsplat.mapshade_server.held.memory_promises import MemoryPromises
budget, taken = MemoryBudget(promises=MemoryPromises(Path(sys.argv[1]))), []
start = threading.Thread.start
def no_thread(_):
    raise RuntimeError("can't start new thread")
for line in sys.stdin:
    what, amount = line.rsplit(maxsplit=1)
    if what == "promises":
        budget.take(int(amount), 0, 0)
    elif what == "takes":
        taken.append(b"1" * int(amount))
    elif what == "settles":
        budget.taken()
    elif what == "has threads":
        threading.Thread.start = start if int(amount) else no_thread
    else:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    print("done", flush=True)
"""


class Server(subprocess.Popen[str]):
    """Another process, which promises and takes as it is told."""

    def does(self, what: str, amount: int = 0) -> None:
        assert self.stdin is not None and self.stdout is not None
        print(what, amount, file=self.stdin, flush=True)
        assert self.stdout.readline() == "done\n"


@contextmanager
def another(folder: Path) -> Iterator[Server]:
    piped = subprocess.PIPE
    with Server([sys.executable, "-c", SERVER, str(folder)], stdin=piped, stdout=piped, text=True) as server:
        try:
            yield server
        finally:
            server.kill()


def promised(promises: MemoryPromises) -> int:
    """By others, as who wants to promise something sees it."""
    seen = list[int]()
    promises.claim(0, seen.append)
    promises.settle()
    return seen[0]


def test_a_promise_counts_until_it_is_kept(tmp_path: Path) -> None:
    mine = MemoryPromises(tmp_path)
    with another(tmp_path) as first, another(tmp_path) as second:
        first.does("promises", 100 * MIB)
        second.does("promises", 50 * MIB)
        assert 100 * MIB < promised(mine) <= 150 * MIB
        first.does("takes", 90 * MIB)
        wait_until(lambda: promised(mine) <= 60 * MIB, "seen to have taken it")
        first.does("settles")
        assert promised(mine) <= 50 * MIB
        second.kill()
        second.wait()
        assert promised(mine) == 0


def test_what_a_server_holds_already_keeps_none_of_its_promise(tmp_path: Path) -> None:
    mine = MemoryPromises(tmp_path)
    with another(tmp_path) as server:
        server.does("takes", 300 * MIB)
        server.does("promises", 100 * MIB)
        assert 90 * MIB < promised(mine) <= 100 * MIB


def test_of_two_that_want_most_of_what_is_left_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = 1000 * MIB
    monkeypatch.setattr(memory_budget, "available_memory", lambda: left)
    budget = MemoryBudget(promises=MemoryPromises(tmp_path))
    with another(tmp_path) as other:
        other.does("promises", 600 * MIB)
        with pytest.raises(NoRoom, match="besides what its other servers are about to take"):
            budget.take(600 * MIB, held=0, let_go=0)
        budget.take(300 * MIB, held=0, let_go=0)
        other.does("settles")
        budget.take(600 * MIB, held=0, let_go=0)
        budget.taken()


def test_what_is_let_go_is_promised_to_nobody_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_budget, "available_memory", lambda: 100 * MIB)
    budget = MemoryBudget(promises=MemoryPromises(tmp_path))
    budget.take(500 * MIB, held=450 * MIB, let_go=450 * MIB)
    budget.taken()


def test_who_cannot_write_its_promise_takes_all_the_same(tmp_path: Path) -> None:
    with another(tmp_path) as first:
        first.does("full")
        first.does("promises", 100 * MIB)
        first.does("takes", 90 * MIB)
        first.does("settles")
    assert promised(MemoryPromises(tmp_path)) == 0


def test_a_file_of_somebody_else_s_is_left_alone(tmp_path: Path) -> None:
    mine = MemoryPromises(tmp_path)
    (file,) = tmp_path.iterdir()
    assert file.stat().st_mode & 0o777 == 0o600
    file.unlink()
    file.symlink_to(tmp_path / "elsewhere")
    assert promised(MemoryPromises(tmp_path)) == promised(MemoryPromises(tmp_path / "missing")) == 0
    assert not (tmp_path / "elsewhere").exists() and promised(mine) == 0


def test_a_promise_is_made_where_no_thread_can_be_had(tmp_path: Path) -> None:
    """The thread that makes promises smaller is begun with the next one instead."""
    mine = MemoryPromises(tmp_path)
    with another(tmp_path) as server:
        server.does("has threads", 0)
        server.does("promises", 100 * MIB)
        server.does("takes", 90 * MIB)
        assert 90 * MIB < promised(mine) <= 100 * MIB
        server.does("has threads", 1)
        server.does("promises", 50 * MIB)
        assert 40 * MIB < promised(mine) <= 50 * MIB
        server.does("takes", 40 * MIB)
        wait_until(lambda: promised(mine) <= 20 * MIB, "seen to have taken it")
