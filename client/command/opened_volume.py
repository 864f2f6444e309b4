"""The volume that a command draws, and the processes that hold it: started here, joined by hand, or this one alone."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from ipaddress import ip_address
from pathlib import Path

import click

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.help_page import FILES, SERVERS, headed
from volsplat.client.command.render_outputs import check_file_writable
from volsplat.client.session.renderer import Renderer
from volsplat.client.session.session import ANY_LOOPBACK_PORT, Session
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.deploy.cluster_file import read_cluster
from volsplat.program.many_imports import many_imports
from volsplat.program.plain_console import PlainConsole
from volsplat.program.server_process import THREADS, silence_option, tls_option
from volsplat.program.this_machine import usable_cores, usual_servers
from volsplat.protocol.description.volume_name import check_is_there
from volsplat.protocol.text.byte_sizes import bytes_from_option
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address, parse_address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS
from volsplat.protocol.wire.tokens import TOKEN_VARIABLE, Token, find_token, new_token


@dataclass(frozen=True)
class Servers:
    """Which processes draw, and where they come from."""

    workers: int
    splat_servers: int
    threads: int  # that the processes started here share out
    single: bool
    listen: Address | None
    token: Token | None
    memory: int | None = None  # bytes of a prepared volume that each may hold
    silence: float = SILENCE_SECONDS  # after which one is lost
    tls: bool | None = None  # between machines
    cluster: Path | None = None  # whose servers are used, instead of all that is said of them here
    data_root: str | None = None  # folder outside of which those started here read nothing
    trace: Path | None = None  # file for what every process does when


COUNT = click.IntRange(min=1)
# How many servers there are, and what those started here may use.
server_options = headed(
    SERVERS,
    click.option("--workers", type=COUNT, default=usual_servers(), help="Map/shade servers (cores, 4 at most)."),
    click.option("--splat-servers", type=COUNT, default=1, help="Splat servers, which share the image (1)."),
    click.option(
        "--threads",
        type=THREADS,
        default=usable_cores(),
        help="Threads that the processes started here share out (cores).",
    ),
    silence_option,
    tls_option,
    click.option(
        "--cluster",
        type=click.Path(path_type=Path),
        help="Use the servers of this cluster file instead; brought up for this if they are not.",
    ),
)


memory_option = headed(
    SERVERS,
    click.option(
        "--memory", metavar="SIZE", help="What each server may hold of a prepared volume, as 2G (half of what is left)."
    ),
)

trace_option = headed(
    FILES,
    click.option(
        "--trace",
        type=click.Path(path_type=Path),
        help="Write what every process does when, for chrome://tracing or Perfetto.",
    ),
)


def servers_from_options(
    workers: int,
    splat_servers: int,
    threads: int,
    listen: str | None,
    token_file: Path | None,
    single: bool = False,
    memory: str | None = None,
    silence: float = SILENCE_SECONDS,
    tls: bool | None = None,
    cluster: Path | None = None,
    trace: Path | None = None,
) -> Servers:
    """What `server_options`, --listen, --token-file, --single and --memory ask for. Raises BadInput."""
    if trace is not None:
        check_file_writable("--trace", trace)
    if cluster is not None:
        if single or listen:
            raise BadInput("--cluster says where the servers are; leave out --single and --listen")
        _refuse_given(_OF_SERVERS | {"threads": "--threads"}, "--cluster names a file that says this of its servers")
        read_cluster(cluster)
    if single:
        _refuse_given(_OF_SERVERS, "--single starts no servers")
    return Servers(
        cluster=cluster,
        workers=workers,
        splat_servers=splat_servers,
        threads=threads,
        single=single,
        listen=parse_address(listen) if listen else None,
        token=shared_token(token_file, makes=listen is not None),
        memory=bytes_from_option("--memory", memory) if memory else None,
        silence=silence,
        tls=tls,
        trace=trace,
    )


# What says how servers are started here, and is of no use without such.
_OF_SERVERS = {"workers": "--workers", "splat_servers": "--splat-servers", "silence": "--silence", "tls": "--tls"}


def _refuse_given(options: dict[str, str], why: str) -> None:
    """Raises BadInput if any of these parameters of the command that runs was given on its line."""
    of_command = click.get_current_context()
    for name, option in options.items():
        if of_command.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            raise BadInput(f"{why}; leave out {option}")


def check_found(volume: str, spawns: bool, cluster: Path | None) -> None:
    """Raises BadInput for a volume that is not there, where the servers are this machine's."""
    if spawns and cluster is None:
        check_is_there(volume)


def shared_token(token_file: Path | None, makes: bool) -> Token | None:
    """The token that the environment or the file gives; `makes` the file if there is none. None: no such wish."""
    if makes and token_file is not None and not token_file.exists():
        token = new_token()
        token.write(token_file)
        return token
    return find_token(os.environ, token_file)


def ignored(text: str) -> None:
    """Tells nobody."""


@contextmanager
def opened(
    volume: str,
    servers: Servers,
    spawns: bool,
    console: PlainConsole,
    also_say: Callable[[str], None] = ignored,
    imports: Sequence[str] = (),
) -> Iterator[Renderer]:
    """The volume, ready to be drawn, with a line on the terminal that says what is going on, and elsewhere as well.

    The modules `imports` are imported while the servers start and read.
    """
    with console.status("starting") as status:

        def say(text: str) -> None:
            status.update(text)
            also_say(text)
            if not console.is_terminal and text.startswith("waiting for servers") and not spawns:
                console.say(text)

        with opened_quietly(volume, servers, spawns, say, console) as renderer:
            with interrupts_held(), many_imports():
                for module in imports:
                    import_module(module)
            renderer.volume.check_has_values()
            tell_notes(renderer.volume, console)
            yield renderer


def tell_notes(volume: SurveyedVolume, console: PlainConsole) -> None:
    """What the reader and the survey warn of, a line each."""
    for warning in (*volume.description.warnings, *volume.notes()):
        console.say(f"note: {warning}")


@contextmanager
def opened_quietly(
    volume: str, servers: Servers, spawns: bool, say: Callable[[str], None], console: PlainConsole
) -> Iterator[Renderer]:
    """As `opened`, with whatever `say` does with the words for what is going on; a lost server is told to stay."""
    if servers.single:
        from volsplat.client.session.single import SingleProcess

        with SingleProcess(
            volume, threads=servers.threads, memory=servers.memory, trace=servers.trace, on_progress=say
        ) as single:
            yield single
        return
    token = servers.token or new_token()

    def keep(loss: str) -> None:
        console.say(f"note: {loss}")

    with session_of(volume, replace(servers, token=token), spawns, say, keep) as session:
        if not spawns and servers.cluster is None:
            tell_how_to_join(session, token, servers.token is not None, console, servers.tls)
        yield session


def session_of(
    volume: str | None,
    servers: Servers,
    spawns: bool,
    say: Callable[[str], None],
    tell_loss: Callable[[str], None] = ignored,
) -> Session:
    """A session that these servers draw for, if there is a volume; it does not wait for that."""
    return Session(
        volume,
        workers=servers.workers,
        splat_servers=servers.splat_servers,
        threads=servers.threads,
        listen=servers.listen or ANY_LOOPBACK_PORT,
        spawn=spawns,
        token=servers.token,
        memory=servers.memory,
        silence=servers.silence,
        tls=servers.tls,
        cluster=servers.cluster,
        trace=servers.trace,
        data_root=servers.data_root,
        on_progress=say,
        on_loss=tell_loss,
    )


def tell_how_to_join(
    session: Session, token: Token, known: bool, console: PlainConsole, tls: bool | None = None
) -> None:
    """Print the commands that start servers by hand."""
    address = session.address
    secret = "" if known else f"{TOKEN_VARIABLE}={token.key.decode()} "
    everywhere = ip_address(address.host).is_unspecified
    joined = Address(socket.gethostname(), address.port) if everywhere else address
    # Servers on other machines must reach the splat server as well, which by itself listens on its own alone.
    opened = "" if ip_address(address.host).is_loopback else " --listen 0.0.0.0:0"
    for command in (f"splat-server --connect {joined}{opened}", f"mapshade-server --connect {joined}"):
        console.say(" ".join((f"{secret}volsplat {command}", *Encryption.of(tls).options)))
