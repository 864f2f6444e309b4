"""Libraries that cannot be loaded, for want of memory or because they are broken: one line, and status 2."""

from __future__ import annotations

import errno
import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.patience import PATIENCE
from support.programs.programs import VOLSPLAT, Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.program.system_failures import load_failure
from volsplat.protocol.messages.refusals import refusal
from volsplat.protocol.messages.session_messages import DescribeMachine


def test_want_of_memory_is_told_whatever_it_is_wrapped_into() -> None:
    segment = ImportError("libtorch_cpu.so: failed to map segment from shared object")
    wrapped = ImportError("numpy could not be imported:\n\na page of advice")
    wrapped.__cause__ = segment
    for error in (
        segment,
        wrapped,
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError("can't start new thread"),
        ImportError("std::bad_alloc"),
    ):
        line = load_failure(error)
        assert line is not None and "not enough memory" in line and "\n" not in line

    processes = load_failure(RuntimeError("can't start new thread"))
    assert processes is not None and "`ulimit -u`" in processes


ANOTHER_USER = (  # of whom root's limits hold, and who may read what is root's
    *("setpriv", "--reuid=54321", "--regid=54321", "--clear-groups"),
    *("--inh-caps=+dac_override", "--ambient-caps=+dac_override"),
)


@pytest.mark.parametrize("limit", [1, 2, 3, 12])
def test_want_of_processes_is_told_in_one_line_and_never_as_an_interruption(
    volume: Path, tmp_path: Path, limit: int
) -> None:
    user = () if os.geteuid() else ANOTHER_USER
    needed = [*user, "prlimit", f"--nproc={limit}"]
    if shutil.which("prlimit") is None or (
        user and (not shutil.which(user[0]) or subprocess.run([*user, "true"]).returncode)
    ):
        pytest.skip("this needs prlimit, and if you are root setpriv, which may become another user")
    done = subprocess.run(
        [*needed, VOLSPLAT, "render", volume, "-o", "x.png", "--workers", "1"],
        cwd=tmp_path,
        env=Person(tmp_path).environment,
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE,
    )
    assert done.returncode in (1, 2) and "Traceback" not in done.stderr and "interrupted" not in done.stderr
    assert "`ulimit -u`" in done.stderr and "process 0" not in done.stderr


def test_a_server_that_gets_no_thread_refuses_with_the_cure_and_no_traceback(caplog: pytest.LogCaptureFixture) -> None:
    error = RuntimeError("can't start new thread")
    refused = refusal(DescribeMachine(), error)
    assert refused.cause == load_failure(error) and not caplog.records


def test_a_library_is_named_only_while_one_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "large_library.py").write_text("raise MemoryError\n")
    monkeypatch.syspath_prepend(tmp_path)

    def large_image() -> None:
        raise MemoryError

    def large_library() -> None:
        importlib.import_module("large_library")

    for work, told in ((large_library, "not enough memory to load a library;"), (large_image, "not enough memory;")):
        with pytest.raises(MemoryError) as failed:
            work()
        line = load_failure(failed.value)
        assert line is not None and line.startswith(told)


def test_a_broken_library_is_told_and_anything_else_is_not() -> None:
    broken = load_failure(ImportError("libOpenImageIO.so.3: cannot open shared object file: No such file"))
    assert broken is not None and "libOpenImageIO.so.3" in broken
    for error in (ModuleNotFoundError("No module named 'x'"), OSError(errno.ENOENT, "gone"), ValueError("no")):
        assert load_failure(error) is None


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volume") / "shells.nrrd"
    write_volume(path, *make_phantom("shells", (8, 8, 8)))
    return path


DRAWN = ("render", "{volume}", "-o", "x.png", "--size", "16x16", "--workers", "1")
VIEWED = ("view", "{volume}", "--no-browser", "--workers", "1", "--grace", "0")
MADE = ("phantom", "shells", "-o", "x.nrrd", "--size", "8")


def run(command: tuple[str, ...], volume: Path, folder: Path, before: str = "", **environment: str) -> str:
    """The one line that the command says at its end, with status 2; `before` is for the shell."""
    words = [str(VOLSPLAT), *(word.replace("{volume}", str(volume)) for word in command)]
    done = subprocess.run(
        ["sh", "-c", f'{before} exec "$@"', "sh", *words],
        cwd=folder,
        env=Person(folder).environment | environment,
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE,
    )
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    (said,) = [line for line in done.stderr.splitlines() if line.startswith("volsplat: ")]
    return said


@pytest.mark.parametrize(
    ("command", "library"),
    [(DRAWN, "OpenImageIO"), (VIEWED, "nicegui"), (MADE, "torch")],
    ids=["render", "view", "phantom"],
)
def test_a_library_that_cannot_be_mapped_ends_a_command_in_one_line(
    volume: Path, tmp_path: Path, command: tuple[str, ...], library: str
) -> None:
    (tmp_path / f"{library}.py").write_text("raise ImportError('lib.so: failed to map segment from shared object')")
    said = run(command, volume, tmp_path, PYTHONPATH=str(tmp_path))
    assert "not enough memory" in said and "lib.so" in said and "ulimit -v" in said


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits a process's addresses")
def test_too_little_memory_for_torch_is_told_before_it_is_loaded(volume: Path, tmp_path: Path) -> None:
    assert "may have 512 MB" in run(MADE, volume, tmp_path, before="ulimit -v 500000;")
