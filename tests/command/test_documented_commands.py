"""What README and docs tell a reader to type works as it stands there."""

import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from support.patience import PATIENCE
from support.programs.documented_commands import Documented, commands, snippets
from support.programs.programs import Person
from support.programs.quick_shell import QuickShell
from volsplat.program.exit_status import EXIT_INTERRUPTED

# Commands of the README that are not run as they stand, and why; that their options exist is tested all the same.
NOT_RUN = {
    r"192\.168\.": "needs other machines: test_command_line.py starts servers by hand on this one",
    r"https://|4HHB|scans/": "needs files of the reader's own: the readers' tests have such",
    r" bench ": "takes minutes: test_bench_commands.py runs each on small volumes",
    r" gallery ": "takes a minute: test_gallery.py draws the plates small",
    r"brain": "needs a volume larger than memory: test_prepare.py prepares and draws small ones",
}

FEWER_FRAMES = " --frames 8"  # than a turn has: each takes as long as an image


def _not_run(line: str) -> bool:
    return any(re.search(pattern, line) for pattern in NOT_RUN)


@pytest.fixture
def reader(tmp_path: Path) -> Person:
    """Someone who follows the README in an empty folder."""
    return Person(tmp_path)


def test_the_tour_of_the_readme_runs_from_top_to_bottom(reader: Person) -> None:
    tour = [one.text for one in commands() if one.page == "README.md" and not _not_run(one.text)]
    assert len(tour) >= 9
    with QuickShell(reader.folder, reader.environment) as shell:
        for line in tour:
            if line.startswith("volsplat view"):
                status, said = _view(reader, line)
            else:
                done = shell.runs(line + FEWER_FRAMES if " movie " in line else line, PATIENCE)
                status, said = done.returncode, done.stdout
            assert status == 0, f"{line}\n{said}"
            assert "Traceback" not in said, line
    for name in ("head.png", "skull.png", "turned.exr", "skin.png", "skin.toml", "turntable.mp4"):
        assert (reader.folder / name).stat().st_size > 0, name


def test_each_reason_not_to_run_a_command_is_of_one_that_is_there() -> None:
    lines = [one.text for one in commands() if one.page == "README.md"]
    for pattern in NOT_RUN:
        assert any(re.search(pattern, line) for line in lines), pattern


@pytest.mark.parametrize("documented", {one.text: one for one in commands()}.values(), ids=str)
def test_a_documented_command_has_options_that_exist(reader: Person, documented: Documented) -> None:
    # Brackets and bars of a synopsis are no part of what is typed.
    words = re.sub(r"[\[\]]", "", re.sub(r"(\w)\|\w+", r"\1", documented.text.partition(" > ")[0]))
    answer = reader.runs(*shlex.split(words)[1:], "--help")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.startswith("Usage: volsplat")


@pytest.mark.parametrize("documented", commands(), ids=str)
def test_no_shell_reads_more_into_a_documented_command(documented: Documented) -> None:
    unquoted = re.sub(r"'[^']*'|\[--.*?\]", "", documented.text)
    assert not re.search(r"[#*?\[\]()&!]", unquoted), "zsh would take this as a pattern: quote it"


@pytest.mark.parametrize("snippet", snippets(), ids=str)
def test_documented_python_runs(reader: Person, snippet: Documented) -> None:
    assert reader.runs("phantom", "head", "--size", "24x32x28", "-o", "head.nrrd").returncode == 0
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", snippet.text],
        cwd=reader.folder,
        env=reader.environment,
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE,
    )
    assert answer.returncode == 0, answer.stderr


def _view(reader: Person, line: str) -> tuple[int, str]:
    """`volsplat view`, until it says where its page is; Ctrl-C then ends it."""
    said = ""
    with reader.starts(*shlex.split(line)[1:], "--no-browser") as process:
        assert process.stderr is not None
        for text in process.stderr:
            said += text
            if "http://" in text:
                process.send_signal(signal.SIGINT)
    return (0 if process.returncode == EXIT_INTERRUPTED else 1), said
