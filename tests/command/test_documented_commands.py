"""What README and docs tell a reader to type works as it stands there."""

import re
import shlex
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from support.checkout import ROOT
from support.patience import PATIENCE
from support.programs.documented_commands import (
    NOT_RUN,
    PAGES,
    TYPED_ALONE,
    TYPED_BY_SITE,
    TYPED_IN_LAB,
    Documented,
    commands,
    fences,
    lines,
    links,
    named_tests,
    reason_not_to_run,
    snippets,
)
from support.programs.programs import Person
from support.programs.quick_shell import QuickShell
from volsplat.program.exit_status import EXIT_INTERRUPTED

SMALL = "64x64x56"  # voxels of the head on pages that take it from the tour
OF_A_LARGER_HEAD = "ignore:the figure lacks the label"  # the small one has no voxel where the text points at
FEWER_FRAMES = " --frames 8"  # than a turn has: each takes as long as an image
DEMO = re.compile(r"^demo:.*\n\t\$\(BIN\)/(volsplat .*)$", re.MULTILINE)


@pytest.fixture
def reader(tmp_path: Path) -> Person:
    """Someone who follows the README in an empty folder."""
    return Person(tmp_path)


@pytest.fixture(scope="module")
def shell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[QuickShell]:
    reader = Person(tmp_path_factory.mktemp("shell"))
    with QuickShell(reader.folder, reader.environment) as shell:
        yield shell


@pytest.mark.parametrize("page", TYPED_ALONE)
def test_a_page_may_be_typed_from_top_to_bottom(reader: Person, shell: QuickShell, page: str) -> None:
    typed = [line.text for line in lines(page) if reason_not_to_run(line) is None]
    assert typed
    (reader.folder / "client").symlink_to(ROOT / "client")  # whose scene files a page may name
    if not any("phantom head" in line for line in typed):
        assert reader.runs("phantom", "head", "--size", SMALL, "-o", "head.nrrd").returncode == 0
    for line in typed:
        if line.startswith("volsplat view"):
            status, said = _view(reader, line)
        else:
            done = shell.runs(_as_run(line), PATIENCE, reader.folder)
            status, said = done.returncode, done.stdout
        assert status == 0, f"{line}\n{said}"
        assert "Traceback" not in said, line
        for made in re.findall(r"(?: -o | > )(\S+)", line):
            assert (reader.folder / made).stat().st_size > 0, line


@pytest.mark.parametrize("page", PAGES)
def test_each_command_is_run_by_a_test_or_has_a_reason_why_not(page: str) -> None:
    whole = page in (*TYPED_ALONE, *TYPED_BY_SITE, *TYPED_IN_LAB) or page.startswith("docs/notes/")
    alone = [] if whole else [line.text for line in lines(page) if reason_not_to_run(line) is None]
    assert alone == [], "run it, or give a reason in NOT_RUN; what is no command goes between ```text and ```"


def test_what_is_neither_a_command_nor_python_says_what_it_is() -> None:
    assert [str(fence) for fence in fences("")] == []


@pytest.mark.parametrize("pattern", NOT_RUN)
def test_each_reason_not_to_run_a_command_is_of_one_that_is_there(pattern: str) -> None:
    assert any(re.search(pattern, line.text) for page in PAGES for line in lines(page))


@pytest.mark.parametrize("documented", fences("toml"), ids=str)
def test_documented_toml_can_be_read(documented: Documented) -> None:
    assert tomllib.loads(documented.text)


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])  # the site's build follows the links of its pages
def test_each_link_leads_to_a_file(page: str) -> None:
    assert [link for link in links(page) if not (ROOT / page).parent.joinpath(link).exists()] == []


def test_each_test_that_a_page_names_is_there() -> None:
    there = {
        f"{file.name}::{test}"
        for file in (ROOT / "tests").rglob("test_*.py")
        for test in re.findall(r"^def (test_\w+)\(", file.read_text(encoding="utf-8"), re.MULTILINE)
    }
    named = named_tests()
    assert len(named) > 100, "pages name tests otherwise by now"
    assert [str(one) for one in named if one.text not in there] == []


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
        [sys.executable, "-W", "error", "-W", OF_A_LARGER_HEAD, "-c", snippet.text],
        cwd=reader.folder,
        env=reader.environment,
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE,
    )
    assert answer.returncode == 0, answer.stderr


def _as_run(line: str) -> str:
    if line == "make demo":  # what make then runs
        (line,) = DEMO.findall((ROOT / "Makefile").read_text(encoding="utf-8"))
    return line + FEWER_FRAMES if " movie " in line else line


def _view(reader: Person, line: str) -> tuple[int, str]:
    """`volsplat view`, until it says where its page is; Ctrl-C then ends it."""
    said = ""
    with closing(reader.begins(*shlex.split(line)[1:], "--no-browser")) as process:
        for text in process.stderr:
            said += text
            if "http://" in text:
                process.send_signal(signal.SIGINT)
        status = process.wait(PATIENCE)
    return (0 if status == EXIT_INTERRUPTED else 1), said
