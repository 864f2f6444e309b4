"""The command `volsplat`: its sub-commands, and how errors and Ctrl-C end it.

Every mistake of the person at the keyboard is one line on stderr and exit status 2.
"""

import logging
import os
import signal
import sys
from importlib.metadata import version
from typing import NoReturn

import click

from volsplat.client.demo_command import demo
from volsplat.client.info_command import info
from volsplat.client.phantom_command import phantom
from volsplat.client.render_command import render
from volsplat.client.scene_command import scene
from volsplat.deploy.server_command import Program, server_command
from volsplat.protocol.errors import BadInput, VolsplatError

EXIT_FAILED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(version("volsplat"), prog_name="volsplat")
@click.option("-v", "--verbose", count=True, help="Say more on stderr; twice for everything.")
def volsplat(verbose: int) -> None:
    """Distributed, interactive volume rendering by splatting."""
    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    logging.basicConfig(level=level, format="volsplat: %(message)s")


def _server_passthrough(name: str, program: Program) -> click.Command:
    """A sub-command that becomes the server itself, so that it alone decides its options."""

    def become(arguments: tuple[str, ...]) -> None:
        command = server_command(program, *arguments)
        os.execv(command[0], command)

    return click.Command(
        name,
        callback=become,
        params=[click.Argument(["arguments"], nargs=-1, type=click.UNPROCESSED)],
        context_settings={"ignore_unknown_options": True, "help_option_names": []},
        add_help_option=False,
        short_help=f"Run a {program.title} that joins a client.",
    )


for command in (render, info, phantom, scene, demo):
    volsplat.add_command(command)
volsplat.add_command(_server_passthrough("mapshade-server", Program.MAPSHADE_SERVER))
volsplat.add_command(_server_passthrough("splat-server", Program.SPLAT_SERVER))


def main() -> NoReturn:
    """The entry point of the console script."""
    signal.signal(signal.SIGTERM, _terminate)
    try:
        volsplat.main(standalone_mode=False)
    except click.Abort:
        _end("interrupted", EXIT_INTERRUPTED)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(EXIT_BAD_INPUT)
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f"; see {context.command_path} --help" if context is not None else ""
        _end(error.format_message().rstrip(".") + hint, EXIT_BAD_INPUT)
    except BadInput as error:
        _end(str(error), EXIT_BAD_INPUT)
    except VolsplatError as error:
        _end(str(error), EXIT_FAILED)
    except KeyboardInterrupt:
        _end("interrupted", EXIT_INTERRUPTED)
    sys.exit(0)


def _terminate(signal_number: int, frame: object) -> NoReturn:
    """Leave by an exception, so that every server is ended on the way out."""
    raise SystemExit(128 + signal_number)


def _end(line: str, status: int) -> NoReturn:
    print(f"volsplat: {line}", file=sys.stderr)
    sys.exit(status)
