"""What the two server programs share as processes: their options, their name, how errors end them."""

import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, Self, TypeVar

import click

from volsplat.program.command_lines import PATH, Seconds
from volsplat.program.counts import Counts
from volsplat.program.exit_status import EXIT_BAD_INPUT, EXIT_INTERRUPTED, quick_end, status_of
from volsplat.program.extras import need
from volsplat.program.log_lines import LogForm, log_format_option, log_to_stderr, say_last
from volsplat.program.system_failures import system_failure
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.messages.message import MOST_THREADS
from volsplat.protocol.messages.session_messages import LEAST_SILENCE, MOST_SILENCE
from volsplat.protocol.text.byte_sizes import bytes_from_option
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.wire.addresses import Address, parse_address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import HELD, SILENCE_SECONDS
from volsplat.protocol.wire.tokens import Token, need_token

log = logging.getLogger(__name__)

Command = TypeVar("Command", bound=Callable[..., Any])


def address_option(context: click.Context, parameter: click.Parameter, value: str | None) -> Address | None:
    """Click's callback for an option HOST:PORT."""
    return None if value is None else parse_address(value)


def bytes_option(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Click's callback for an option that is a number of bytes, as 2G."""
    return None if value is None else bytes_from_option(parameter.opts[0], value)


def together(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """One decorator for several options, which help lists in this order."""

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


tls_option = click.option(
    "--tls/--no-tls",
    default=None,
    help="TLS by loopback as well, or nowhere; on both sides alike (between machines).",
)
silence_option = click.option(
    "--silence",
    type=Seconds(LEAST_SILENCE, MOST_SILENCE),
    default=SILENCE_SECONDS,
    help=f"Seconds until a silent server counts as lost; a client, {HELD:g} times as many ({SILENCE_SECONDS:g}).",
)

# Where metrics are handed out, for `Metrics.of`.
metrics_options = together(
    click.option(
        "--metrics",
        metavar="HOST:PORT",
        callback=address_option,
        help="Metrics for Prometheus at this address (:PORT for this machine alone).",
    ),
    click.option("--metrics-token", type=PATH, help="File with their bearer token; made if missing."),
)


@dataclass(frozen=True)
class Metrics:
    """Where metrics are handed out, and the bearer token that whoever reads them must show."""

    address: Address
    token: Token

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self | None:
        """What `metrics_options` gave a command; the token's file is made if it is missing. Raises BadInput."""
        address, token_file = given["metrics"], given["metrics_token"]
        if address is None:
            return None
        need("prometheus_client", "--metrics", "metrics")
        if token_file is None:
            raise BadInput("--metrics needs --metrics-token FILE: a token that whoever reads metrics must show")
        from volsplat.program.metrics_door import door_token

        return cls(address, door_token(token_file))


@contextmanager
def metrics_of(counts: Callable[[], Counts], asked: Metrics | None) -> Iterator[None]:
    """Hand out what `counts` gives at each asking, where that is asked for. Raises BadInput."""
    if asked is None:
        yield
        return
    from volsplat.program.metrics_door import MetricsDoor  # brings an HTTP server, which few ask for

    door = MetricsDoor(asked.address, asked.token, counts)
    try:
        log.warning("metrics are at http://%s/metrics", door.address)
        yield
    finally:
        door.close()


def log_as_asked(title: str, given: Mapping[str, Any]) -> None:
    """Log as `process_options` ask for."""
    level = logging.INFO if given["verbose"] else logging.WARNING
    log_to_stderr(title, level, LogForm(given["log_format"]))


THREADS = click.IntRange(1, MOST_THREADS)

# How a server finds its clients, for `ServerOptions.of`.
client_options = together(
    click.option("--connect", metavar="HOST:PORT", callback=address_option, help="The client, which is dialled …"),
    click.option("--wait-at", metavar="HOST:PORT", callback=address_option, help="… or where clients dial."),
    click.option(
        "--token-file",
        type=PATH,
        help="File with the session token, - for stdin (VOLSPLAT_TOKEN).",
    ),
    click.option("--patience", type=Seconds(0), default=60.0, help="Seconds to wait for the client (60)."),
    click.option("--resident", is_flag=True, help="Serve one client after the other, and keep what was read."),
    click.option(
        "--keep",
        type=Seconds(0, least_open=True),
        default=600.0,
        metavar="SECONDS",
        help="End after so long without a client, if resident (600).",
    ),
)

# What else a server is told as a process, for `ServerOptions.of` and `log_as_asked`.
process_options = together(
    click.option("--threads", type=THREADS, help="Threads that work on a frame (cores)."),
    click.option(
        "--sharing", type=click.IntRange(min=1), default=1, help="Servers of this kind that share the cores here (1)."
    ),
    click.option("--name", default="", help="What the client calls it, beside its host and process."),
    tls_option,
    silence_option,
    metrics_options,
    click.option("-v", "--verbose", is_flag=True, help="Say on stderr what is done."),
    log_format_option,
)


@dataclass(frozen=True)
class ServerOptions:
    """What both server programs are told alike: whom they serve, for how long, and as what."""

    connect: Address | None  # the client, which is dialled …
    wait_at: Address | None  # … or where clients dial
    token: Token
    patience: float  # seconds for the first client, and for one that was lost
    resident: bool  # it outlives its clients …
    keep: float  # … and stays so many seconds without any
    encryption: Encryption
    silence: float  # seconds after which a peer is lost
    name: str
    metrics: Metrics | None
    wanted_threads: int | None
    sharing: int  # servers of its kind share the cores

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """What `client_options` and `process_options` gave a command. Raises BadInput."""
        metrics, token = Metrics.of(given), need_token(os.environ, given["token_file"])
        if (given["connect"] is None) == (given["wait_at"] is None):
            raise BadInput("give --connect HOST:PORT, where the client listens, or --wait-at HOST:PORT, where it dials")
        return cls(
            connect=given["connect"],
            wait_at=given["wait_at"],
            token=token,
            patience=given["patience"],
            resident=given["resident"],
            keep=given["keep"],
            encryption=Encryption.of(given["tls"]),
            silence=given["silence"],
            name=given["name"],
            metrics=metrics,
            wanted_threads=given["threads"],
            sharing=given["sharing"],
        )

    @property
    def threads(self) -> int:
        """As many as asked for, else this server's share of the cores."""
        return self.wanted_threads or max(1, min(usable_cores() // self.sharing, MOST_THREADS))


@quick_end()
def run_server(module: str, name: str, title: str, given: object = None) -> NoReturn:
    """Run the command `name` of a module; an error is one line on stderr, exit status 2 if a person must act.

    `given` is for the command, which takes it by click.pass_obj.
    """
    with suppress(OSError):  # Linux: what `top` and `ps` show
        Path("/proc/self/comm").write_text(title, encoding="utf-8")
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # as who became this program has left it
        command: click.Command = getattr(import_module(module), name)
        command.main(prog_name=command.name, standalone_mode=False, obj=given)
    except click.ClickException as error:
        _end(title, error.format_message(), EXIT_BAD_INPUT)
    except VolsplatError as error:
        _end(title, str(error), status_of(error))
    except (KeyboardInterrupt, click.Abort):
        _end(title, "interrupted", EXIT_INTERRUPTED)
    except Exception as error:
        if (told := system_failure(error)) is None:
            raise
        _end(title, str(told), status_of(told))
    sys.exit(0)


def _end(title: str, line: str, status: int) -> NoReturn:
    say_last(title, line)
    sys.exit(status)
