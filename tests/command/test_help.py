"""Help: options under headings, examples that can be typed, and what a shell completes."""

import os
import shlex
import subprocess
import sys
from importlib.util import find_spec

import click
import pytest

from volsplat.bench.commands.command import SUMMARIES, bench
from volsplat.client.command.choices import Words
from volsplat.client.command.commands import ENTRIES, reading_modules, starts_servers, volsplat
from volsplat.client.command.deploy_command import deploy
from volsplat.client.command.help_page import OTHERS, HelpedCommand
from volsplat.mapshade_server.command import mapshade_server
from volsplat.mapshade_server.prepare.command import prepare_command
from volsplat.protocol.description.refinement_steps import Step
from volsplat.splat_server.command import splat_server

HELPED = [
    name
    for name, entry in ENTRIES.items()
    if not entry.program and isinstance(volsplat.get_command(click.Context(volsplat), name), HelpedCommand)
]
# Those of groups, and those that are programs of their own.
FURTHER = {
    **{f"deploy {name}": command for name, command in deploy.commands.items()},
    **{f"bench {name}": bench.get_command(click.Context(bench), name) for name in SUMMARIES},
    "prepare": prepare_command,
    "mapshade-server": mapshade_server,
    "splat-server": splat_server,
}
WITH_HEADINGS = ("view", "render", "movie", "export")


def command(name: str) -> click.Command:
    found = volsplat.get_command(click.Context(volsplat, info_name="volsplat"), name)
    assert found is not None
    return found


def help_of(name: str) -> str:
    return command(name).get_help(click.Context(command(name), info_name=name))


def test_every_command_of_one_heading_is_listed_together() -> None:
    headings = [entry.heading for entry in ENTRIES.values()]
    assert headings == sorted(headings, key=headings.index)
    text = volsplat.get_help(click.Context(volsplat, info_name="volsplat"))
    assert all(f"\n{heading}:\n" in text for heading in headings)
    assert all(f"\n  {name} " in text for name in ENTRIES)


@pytest.mark.parametrize("name", WITH_HEADINGS)
def test_of_long_help_only_help_itself_has_no_heading(name: str) -> None:
    _, others = help_of(name).split(f"\n{OTHERS}:\n")
    assert others.split("\n\n")[0].split() == "--help Show this message and exit.".split()


@pytest.mark.parametrize("name", HELPED)
def test_the_examples_are_commands_as_they_may_be_typed(name: str) -> None:
    epilog = command(name).epilog or ""
    examples = [line for line in epilog.splitlines() if line.startswith("  ")]
    assert examples
    for example in examples:
        words = shlex.split(example.split("volsplat ", 1)[1].split(" > ")[0])
        assert words[0] == name
        command(name).make_context(name, words[1:])


@pytest.mark.parametrize("name", FURTHER)
def test_further_commands_have_examples_as_well(name: str) -> None:
    described = FURTHER[name]
    assert described is not None
    examples = [line for line in (described.epilog or "").splitlines() if line.startswith("  ")]
    assert examples
    for example in examples:
        words = shlex.split(example)
        said = ["volsplat", *name.split()]
        assert words[: len(said)] == said
        described.make_context(name, words[len(said) :])


def test_help_of_demo_and_gallery_does_not_wait_for_torch() -> None:
    load = "get_command(click.Context(volsplat), name)"
    program = (
        "import click, sys; from volsplat.client.command.commands import volsplat\n"
        f"for name in ('demo', 'gallery'): assert volsplat.{load} is not None and 'torch' not in sys.modules, name"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def completed(typed: str) -> list[str]:
    """What a shell is told of the last word."""
    asked = {"COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" ")), "_VOLSPLAT_COMPLETE": "bash_complete"}
    program = [
        sys.executable,
        "-c",
        "import sys; sys.argv[0] = 'volsplat'; from volsplat.client.command.cli import main; main()",
    ]
    done = subprocess.run(program, env=os.environ | asked, capture_output=True, encoding="utf-8", check=True)
    return done.stdout.split()


@pytest.mark.parametrize(
    ("name", "steps"), [("render", "[A|B|C|D|E|F|G]"), ("movie", "[A|B|C|D|E|F|G]"), ("gallery", "[F|G]")]
)
def test_steps_are_listed_by_their_letters(name: str, steps: str) -> None:
    assert f"--step {steps}" in command(name).get_help(click.Context(command(name)))


def test_words_are_listed_as_click_lists_choices() -> None:
    shown, hidden = (
        click.Option(["--step"], type=Words(Step)),
        click.Option(["--it"], type=Words("AB"), show_choices=False),
    )
    needed = click.Argument(["step"], type=Words(["A", "b"]))
    told = [one.make_metavar(click.Context(click.Command("draw"))) for one in (shown, hidden, needed)]
    assert told == ["[A|B|C|D|E|F|G]", "[TEXT]", "{A|b}"]


def test_a_shell_completes_commands_presets_and_files() -> None:
    assert completed("volsplat m") == ["plain,movie", "plain,mapshade-server"]
    assert completed("volsplat render head.nrrd --preset ct-") == [
        f"plain,ct-{word}" for word in ("angio", "bone", "lung", "skin", "soft-tissue")
    ]
    assert completed("volsplat render he") == ["file,he"]


@pytest.mark.parametrize(
    ("line", "starts"),
    [
        ("render head.nrrd -o head.png", True),
        ("--log-format json view head.nrrd --workers 3", True),
        ("render head.nrrd -o head.png --single", False),
        ("movie head.nrrd -o turn.mp4 --cluster=lab.toml", False),
        ("view --help", False),
        ("export head.nrrd -o head.ply", False),
        ("info head.nrrd", False),
        ("", False),
    ],
)
def test_servers_are_loaded_ahead_only_for_commands_that_start_some(line: str, starts: bool) -> None:
    assert starts_servers(line.split()) is starts


@pytest.mark.parametrize(
    ("line", "loads"),
    [
        ("render cube.FITS#1,axis4=0 -o cube.png", True),
        ("view cube.fits.gz", True),
        ("view night#2.fits", True),
        ("render head.nrrd -o head.png", False),
    ],
)
def test_what_reads_a_fits_cube_is_loaded_ahead_only_for_one(line: str, loads: bool) -> None:
    modules = reading_modules(line.split())
    assert bool(modules) is loads and all(map(find_spec, modules))
