"""Help that is read: options under headings, an example at the end; and what a shell completes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from volsplat.program.command_lines import PATH, examples
from volsplat.program.server_process import together

Command = TypeVar("Command", bound=Callable[..., Any])

OTHERS = "Options"  # the heading of what has none
FILES, SCENE, SERVERS = "Files", "What is drawn", "Servers"
_HEADING = "heading"  # the attribute of a parameter that has one


class HelpedCommand(click.Command):
    """Lists its options by their headings, in the order in which these come first."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        by_heading: defaultdict[str, list[tuple[str, str]]] = defaultdict(list)
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record is not None:
                by_heading[getattr(parameter, _HEADING, OTHERS)].append(record)
        for heading in sorted(by_heading, key=lambda heading: heading == OTHERS):
            with formatter.section(heading):
                formatter.write_dl(by_heading[heading])


def helped(*typed: str, text: str | None = None) -> Callable[[Callable[..., Any]], click.Command]:
    """A command whose help ends with these lines to type; it begins with the function's docstring, or with a text."""
    about = {} if text is None else {"help": text}
    return click.command(cls=HelpedCommand, epilog=examples(*typed), **about)


def headed(heading: str, *options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """One decorator for several options, which help lists in this order under a heading."""

    def add(command: Command) -> Command:
        before = len(_parameters(command))
        command = together(*options)(command)
        for parameter in _parameters(command)[before:]:
            setattr(parameter, _HEADING, heading)
        return command

    return add


def _parameters(command: Callable[..., Any]) -> list[click.Parameter]:
    """Those that click's decorators have noted at a function so far."""
    return list(getattr(command, "__click_params__", []))


def complete_files(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The shell's own completion of files."""
    return [CompletionItem(incomplete, type="file")]


volume_argument = click.argument("volume", shell_complete=complete_files)
volumes_argument = click.argument(
    "volumes", nargs=-1, required=True, metavar="VOLUME...", shell_complete=complete_files
)


def output_option(told: str, required: bool = True) -> Callable[[Command], Command]:
    return click.option("-o", "--output", type=PATH, required=required, help=told)
