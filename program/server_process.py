"""What the two server programs share as processes: their options, their name, how errors end them."""

import os
import socket
import sys
from importlib import import_module
from pathlib import Path
from typing import NoReturn

import click

from volsplat.program.exit_status import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_INTERRUPTED
from volsplat.program.load_failures import load_failure
from volsplat.protocol.messages.message import MOST_THREADS
from volsplat.protocol.messages.session_messages import LEAST_SILENCE, MOST_SILENCE
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.text.printable import one_line
from volsplat.protocol.wire.addresses import Address, parse_address
from volsplat.protocol.wire.heartbeat import AT_WORK, SILENCE_SECONDS


def address_option(context: click.Context, parameter: click.Parameter, value: str) -> Address:
    """Click's callback for an option HOST:PORT."""
    return parse_address(value)


connect_option = click.option(
    "--connect", "client", required=True, metavar="HOST:PORT", callback=address_option, help="The client."
)
token_file_option = click.option(
    "--token-file", type=click.Path(path_type=Path), help="File with the session token (VOLSPLAT_TOKEN)."
)
patience_option = click.option(
    "--patience", type=click.FloatRange(min=0), default=60.0, help="Seconds to wait for the client (60)."
)
silence_option = click.option(
    "--silence",
    type=click.FloatRange(LEAST_SILENCE, MOST_SILENCE),
    default=SILENCE_SECONDS,
    help=f"Seconds until a silent server counts as lost; a client, {AT_WORK:g} times as many ({SILENCE_SECONDS:g}).",
)
verbose_option = click.option("-v", "--verbose", is_flag=True, help="Say on stderr what is done.")


THREADS = click.IntRange(1, MOST_THREADS)


def process_name() -> str:
    """What other processes call this one in messages: its host and process id."""
    return f"{socket.gethostname()}, process {os.getpid()}"


def run_server(module: str, name: str, title: str) -> NoReturn:
    """Run the command `name` of a module; an error is one line on stderr, exit status 2 if a person must act."""
    try:
        command: click.Command = getattr(import_module(module), name)
        command.main(prog_name=command.name, standalone_mode=False)
    except click.ClickException as error:
        _end(title, error.format_message(), EXIT_BAD_INPUT)
    except BadInput as error:
        _end(title, str(error), EXIT_BAD_INPUT)
    except VolsplatError as error:
        _end(title, str(error), EXIT_FAILED)
    except (KeyboardInterrupt, click.Abort):
        _end(title, "interrupted", EXIT_INTERRUPTED)
    except Exception as error:
        if (line := load_failure(error)) is None:
            raise
        _end(title, line, EXIT_BAD_INPUT)
    sys.exit(0)


def _end(title: str, line: str, status: int) -> NoReturn:
    print(f"{title}: {one_line(line)}", file=sys.stderr)
    sys.exit(status)
