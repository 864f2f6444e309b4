"""The sub-commands of `volsplat`, each imported only when it is called."""

import logging
import os
import resource
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import NamedTuple

import click

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.deploy.server_command import Program, server_command
from volsplat.program.log_lines import log_to_stderr
from volsplat.protocol.text.errors import BadInput

LEAST_MEMORY_FOR_TORCH = 900 * 10**6  # bytes of addresses; with less it can abort while it is loaded


class Entry(NamedTuple):
    summary: str
    module: str = ""  # with a command of the entry's name
    program: Program | None = None  # that the command becomes
    images: bool = True  # it makes images or volumes, by torch


ENTRIES = {
    "view": Entry("Show a volume in the browser, with every control.", "volsplat.client.command.view_command"),
    "render": Entry("Draw a volume into an image.", "volsplat.client.command.render_command"),
    "movie": Entry("Turn a volume around, or fly through it, into a movie.", "volsplat.client.command.movie_command"),
    "demo": Entry("Draw the head phantom, step by step, into a folder.", "volsplat.client.command.demo_command"),
    "gallery": Entry("Draw the paper's sixteen images on four plates.", "volsplat.client.command.gallery_command"),
    "info": Entry("Tell what a volume is, with its histogram.", "volsplat.client.command.info_command", images=False),
    "scene": Entry("Print a complete scene file to start from.", "volsplat.client.command.scene_command", images=False),
    "phantom": Entry("Write a volume that volsplat makes itself.", "volsplat.client.command.phantom_command"),
    "prepare": Entry("Turn a volume of any size into a packet store on disk.", program=Program.PREPARE),
    "bench": Entry("Measure volsplat: its paper, its floors, its peers.", "volsplat.bench.commands.command"),
    "mapshade-server": Entry("Run a map/shade server that joins a client.", program=Program.MAPSHADE_SERVER),
    "splat-server": Entry("Run a splat server that joins a client.", program=Program.SPLAT_SERVER),
}


class Commands(click.Group):
    """Finds sub-commands in ENTRIES, and lists them without importing any."""

    def list_commands(self, context: click.Context) -> list[str]:
        return list(ENTRIES)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        entry = ENTRIES.get(name)
        if entry is None:
            return None
        if entry.program is not None:
            return _becoming(name, entry.program)
        if entry.images:
            _need_torch(name)
        with interrupts_held():
            command: click.Command = getattr(import_module(entry.module), name)
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.summary) for name, entry in ENTRIES.items()])


def _need_torch(command: str) -> None:
    """Raises BadInput if torch is not installed, as on a machine that only works for others, or cannot be loaded."""
    if find_spec("torch") is None:
        raise BadInput(f"{command} needs torch, which is not installed: pip install 'volsplat[client]'")
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    if allowed != resource.RLIM_INFINITY and allowed < LEAST_MEMORY_FOR_TORCH:
        least, given = (f"{size // 10**6} MB" for size in (LEAST_MEMORY_FOR_TORCH, allowed))
        raise BadInput(f"{command} needs torch, which takes {least}, and may have {given}; raise `ulimit -v`")


def _becoming(name: str, program: Program) -> click.Command:
    """A sub-command that becomes the program itself, so that it alone decides its options."""

    def become(arguments: tuple[str, ...]) -> None:
        command = server_command(program, *arguments)
        os.execv(command[0], command)

    return click.Command(
        name,
        callback=become,
        params=[click.Argument(["arguments"], nargs=-1, type=click.UNPROCESSED)],
        context_settings={"ignore_unknown_options": True},
        add_help_option=False,
    )


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(version("volsplat"), prog_name="volsplat")
@click.option("-v", "--verbose", count=True, help="Say more on stderr; twice for everything.")
def volsplat(verbose: int) -> None:
    """Distributed, interactive volume rendering by splatting."""
    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    log_to_stderr("volsplat", level)
