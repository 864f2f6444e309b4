"""Nothing that a person typed, and no name of a file, is ever markup, emoji or a command to the terminal."""

from __future__ import annotations

import ast
import re
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest
from rich.progress import Progress
from rich.table import Table

from support.checkout import ROOT
from support.programs.programs import Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.program.plain_console import PlainConsole, task_words

PROGRAMS = ("client", "deploy", "program", "protocol", "mapshade_server", "splat_server", "bench")
THE_CONSOLE = ROOT / "program" / "plain_console.py"

HARMLESS = "a[red]b[/c]:smile:[link=x]"
STEERING = "e\x1b[31mvil\x07\n\u202ename"
STEERING_SHOWN = re.compile(r"e\?\[31mvil\?[ ?]\?name")


def on_a_terminal(console: PlainConsole) -> PlainConsole:
    """As it is in front of a person, who sees a bar and a status."""
    console._force_terminal = True
    return console


def test_words_are_printed_as_they_are() -> None:
    console = PlainConsole()
    with console.capture() as said:
        console.say(HARMLESS)
        table = Table(title=HARMLESS, box=None)
        table.add_column(HARMLESS, no_wrap=True)
        table.add_row(HARMLESS)
        console.print(table)
    assert said.get().count(HARMLESS) == 4


def test_a_status_and_a_bar_show_words_as_they_are() -> None:
    console = on_a_terminal(PlainConsole())
    with console.capture() as said:
        with console.status(HARMLESS) as status:
            status.update(HARMLESS + "2")
            console.print(status.renderable)
        with Progress(task_words(), console=console) as progress:
            progress.add_task("{0}" + HARMLESS)
    assert HARMLESS + "2" in said.get() and "{0}" + HARMLESS in said.get()


def test_charts_have_strokes_that_the_terminal_has() -> None:
    for encoding, shown in (("utf-8", "▁▄█ ──"), ("latin-1", ".;# --")):
        console = PlainConsole()
        console.file = TextIOWrapper(BytesIO(), encoding)
        console.print("▁▄█ ──")
        console.file.flush()
        assert console.file.buffer.getvalue().decode(encoding) == f"{shown}\n"


def test_nothing_steers_the_terminal() -> None:
    console = PlainConsole()
    with console.capture() as said:
        console.say(STEERING)
        table = Table(title=STEERING, box=None)
        table.add_row(STEERING)
        console.print(table)
        console.print(STEERING)
    assert all(line.isprintable() for line in said.get().split("\n"))
    assert STEERING_SHOWN.search(said.get().splitlines()[0])


def test_a_long_line_is_not_broken() -> None:
    console = PlainConsole()
    with console.capture() as said:
        console.say("/long/path" * 50)
    assert said.get() == "/long/path" * 50 + "\n"


# -- the commands, with names that are markup

NAME = "o[red]2:smile:"
MARKED = f"a[b]x{NAME}"  # a file; a slash would make it two


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With volumes whose paths hold markup that opens, closes and does not fit, and characters that steer."""
    folder = tmp_path_factory.mktemp("volumes")
    (folder / "a[").mkdir()
    for name in ("a[/b]x.nrrd", f"{MARKED}.nrrd", f"{STEERING}.nrrd"):
        write_volume(folder / name, *make_phantom("shells", (12, 12, 12)))
    return folder


SMALL = ("--single", "--size", "24x24")
COMMANDS = {
    "render": ("render", "a[/b]x.nrrd", "-o", f"{NAME}.png", *SMALL),
    "render in steps": ("render", "a[/b]x.nrrd", "--steps-dir", NAME, *SMALL),
    "movie": ("movie", "a[/b]x.nrrd", "-o", f"{NAME}-movie", "--frames", "2", *SMALL),
    "phantom": ("phantom", "shells", "-o", f"{NAME}.nrrd", "--size", "8"),
    "prepare": ("prepare", "a[/b]x.nrrd", f"{NAME}.zarr"),
    "info": ("info", f"{MARKED}.nrrd"),
    "gallery": ("gallery", f"{MARKED}.nrrd"),  # which is no folder
    "no volume": ("render", f"{NAME}[/b]", "-o", "x.png"),
    "no such preset": ("view", "a[/b]x.nrrd", "--preset", NAME),
    "no such step": ("render", "a[/b]x.nrrd", "-o", "x.png", "--step", NAME),
    "no such command": (f"{NAME}[/b]",),
    "no such scene": ("render", "a[/b]x.nrrd", "-o", "x.png", "--scene", f"{NAME}[/b].toml"),
    "no such record": ("bench", "compare", f"{NAME}[/b]", "other"),
}


@pytest.mark.parametrize("case", COMMANDS)
def test_a_command_says_names_as_they_are(folder: Path, case: str) -> None:
    done = Person(folder).runs(*COMMANDS[case])
    said = done.stdout + done.stderr
    assert NAME in said and "Traceback" not in said
    assert done.returncode == (2 if done.stderr.startswith("volsplat: ") else 0)


@pytest.mark.parametrize("written", [f"{STEERING}.png", "x.png"])
@pytest.mark.parametrize("volume", [f"{STEERING}.nrrd", f"{STEERING}.absent.nrrd"])
def test_a_command_steers_no_terminal(folder: Path, volume: str, written: str) -> None:
    for command in (("render", volume, "-o", written, *SMALL), ("-v", "info", volume)):
        done = Person(folder).runs(*command)
        assert all(line.isprintable() for line in (done.stdout + done.stderr).split("\n"))


# -- and nobody goes around the one console


@pytest.mark.parametrize("part", PROGRAMS)
def test_all_that_is_printed_goes_through_the_one_console(part: str) -> None:
    around: list[str] = []
    for path in sorted((ROOT / part).rglob("*.py")):
        if path == THE_CONSOLE:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            imported = [name.name for name in node.names] if isinstance(node, ast.ImportFrom) else []
            if {"Console", "Status", "Prompt", "TextColumn", "print"} & set(imported) and "rich" in ast.unparse(node):
                around.append(f"{path.relative_to(ROOT)} has a console of rich's own: {ast.unparse(node)}")
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith((".from_markup", ".from_ansi")):
                around.append(f"{path.relative_to(ROOT)}:{node.lineno} reads markup")
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("console.print"):
                if any(isinstance(argument, ast.JoinedStr | ast.Constant) for argument in node.args):
                    around.append(f"{path.relative_to(ROOT)}:{node.lineno} prints a string; use say")
    assert not around
