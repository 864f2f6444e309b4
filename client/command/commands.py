"""The sub-commands of `volsplat`, each imported only when it is called."""

import logging
import os
import resource
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from itertools import groupby
from shlex import quote
from typing import NamedTuple

import click
from click.shell_completion import CompletionItem

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.deploy.server_command import Program
from volsplat.program.command_lines import HELP
from volsplat.program.extras import need
from volsplat.program.log_lines import FORM_VARIABLE, LogForm, log_format_option, log_to_stderr
from volsplat.program.many_imports import many_imports
from volsplat.protocol.description.volume_name import possible_places
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.meant import meant

LEAST_MEMORY_FOR_TORCH = 900 * 10**6  # bytes of addresses; with less it can abort while it is loaded
# With one of these a command starts no servers.
SERVES_NOBODY = {"--single", "--cluster", "--listen", "--help", "-h"}
# What readers need that takes long to load, so that servers share it, by the ends of files' names.
READING_MODULES = {(".fits", ".fit", ".fits.gz"): ("astropy.io.fits", "astropy.wcs")}
DRAW, VOLUMES, MACHINES, MEASURE = "Show and draw", "Volumes and scenes", "Machines", "Measure"


class Entry(NamedTuple):
    heading: str  # under which it is listed
    summary: str
    torch: bool = False  # it makes volumes, by torch
    program: str = ""  # the module of the program that the command becomes
    serves: bool = False  # it starts servers, unless it is told otherwise
    module: str = "volsplat.client.command.{name}_command"  # with a command of the entry's name


ENTRIES = {
    "view": Entry(DRAW, "Show a volume in the browser, with every control.", serves=True),
    "render": Entry(DRAW, "Draw a volume into an image.", serves=True),
    "movie": Entry(DRAW, "Turn a volume around, or fly through it, into a movie.", serves=True),
    "export": Entry(DRAW, "Write what is visible as 3-D Gaussians, or a surface as a mesh."),
    "demo": Entry(DRAW, "Draw the head phantom, step by step, into a folder.", torch=True),
    "gallery": Entry(DRAW, "Draw the paper's sixteen images on four plates.", torch=True),
    "info": Entry(VOLUMES, "Print what a volume is, with its histogram."),
    "scene": Entry(VOLUMES, "Print the scene of a volume, an image or a preset."),
    "phantom": Entry(VOLUMES, "Write a volume that volsplat makes itself.", torch=True),
    "prepare": Entry(
        VOLUMES, "Turn a volume of any size into a packet store on disk.", program="volsplat.deploy.batch"
    ),
    "deploy": Entry(MACHINES, "Start servers on a lab's machines, check on them, end them."),
    Program.MAPSHADE_SERVER.command: Entry(
        MACHINES, "Run a map/shade server that joins a client.", program=Program.MAPSHADE_SERVER.value
    ),
    Program.SPLAT_SERVER.command: Entry(
        MACHINES, "Run a splat server that joins a client.", program=Program.SPLAT_SERVER.value
    ),
    "bench": Entry(
        MEASURE,
        "Measure volsplat: its paper, its floors, its peers.",
        torch=True,
        module="volsplat.bench.commands.command",
    ),
}


def starts_servers(words: Sequence[str]) -> bool:
    """Whether a command line will start servers; guessed, since the command takes a while to import."""
    serves = any(ENTRIES[word].serves for word in words if word in ENTRIES)
    return serves and not SERVES_NOBODY.intersection(word.partition("=")[0] for word in words)


def reading_modules(words: Sequence[str]) -> list[str]:
    """What servers will need to read the volume that a command line names; guessed likewise."""
    places = [place.lower() for word in words for place in possible_places(word)]
    ends = [end for end in READING_MODULES if any(place.endswith(end) for place in places)]
    return [module for end in ends for module in READING_MODULES[end]]


class Commands(click.Group):
    """Finds sub-commands in ENTRIES, and lists them without importing any."""

    def list_commands(self, context: click.Context) -> list[str]:
        return list(ENTRIES)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        entry = ENTRIES.get(name)
        if entry is None:
            raise click.UsageError(f"there is no command {name!r} ({_command_meant(name)})", context)
        if entry.program:
            return _becoming(name, entry.program)
        if entry.torch:
            _need_torch(name)
        with interrupts_held(), many_imports():
            command: click.Command = getattr(import_module(entry.module.format(name=name)), name)
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        for heading, entries in groupby(ENTRIES.items(), lambda named: named[1].heading):
            with formatter.section(heading):
                formatter.write_dl([(name, entry.summary) for name, entry in entries])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """As click, without importing the commands."""
        named = [CompletionItem(name, help=ENTRIES[name].summary) for name in ENTRIES if name.startswith(incomplete)]
        return named + click.Command.shell_complete(self, ctx, incomplete)


def _command_meant(name: str) -> str:
    if name == "help":
        return "it is an option, --help"
    if any(map(os.path.exists, possible_places(name))):
        return f"to look at it: volsplat view {quote(name)}"
    return meant(name, list(ENTRIES))


def _need_torch(command: str) -> None:
    """Raises BadInput if torch is not installed, or would end the process while it is loaded."""
    need("torch", command, "torch")
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    if allowed != resource.RLIM_INFINITY and allowed < LEAST_MEMORY_FOR_TORCH:
        least, given = (f"{size // 10**6} MB" for size in (LEAST_MEMORY_FOR_TORCH, allowed))
        raise BadInput(f"{command} needs torch, which takes {least}, and may have {given}; raise `ulimit -v`")


def _becoming(name: str, program: str) -> click.Command:
    """A sub-command that becomes the program itself, so that it alone decides its options."""

    def become(arguments: tuple[str, ...]) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # until the program can tell of it: see run_server
        os.execv(sys.executable, [sys.executable, "-m", program, *arguments])

    return click.Command(
        name,
        callback=become,
        params=[click.Argument(["arguments"], nargs=-1, type=click.UNPROCESSED)],
        context_settings={"ignore_unknown_options": True},
        add_help_option=False,
    )


@click.group(
    cls=Commands,
    context_settings=HELP,
    epilog="\b\nFirst steps:\n  volsplat phantom head -o head.nrrd\n  volsplat view head.nrrd",
)
@click.version_option(package_name="volsplat", prog_name="volsplat")
@click.option("-v", "--verbose", count=True, help="Say more on stderr; twice for everything.")
@log_format_option
def volsplat(verbose: int, log_format: str) -> None:
    """Distributed, interactive volume rendering by splatting."""
    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    log_to_stderr("volsplat", level, LogForm(log_format))
    if log_format != LogForm.TEXT:
        os.environ[FORM_VARIABLE] = log_format  # for the servers that are started here
