"""What commands that draw take on their command line for servers: which processes draw, and where they come from."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from volsplat.client.command.help_page import FILES, SERVERS, Command, headed
from volsplat.client.command.render_outputs import check_file_writable
from volsplat.deploy.cluster_file import read_cluster
from volsplat.program.command_lines import PATH
from volsplat.program.server_process import THREADS, address_option, bytes_option, silence_option, tls_option
from volsplat.program.this_machine import usable_cores, usual_servers
from volsplat.protocol.description.volume_name import check_is_there
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS
from volsplat.protocol.wire.tokens import Token, find_token, new_token

if TYPE_CHECKING:
    from volsplat.client.session.kept_cluster import KeptCluster

COUNT = click.IntRange(min=1)

# How many servers there are, and what those started here may use.
server_options = headed(
    SERVERS,
    click.option(
        "--workers",
        type=COUNT,
        default=usual_servers(),
        help="Map/shade servers, which share all cores (one a core, 4 at most).",
    ),
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
        type=PATH,
        help="Use the servers of this cluster file instead; brought up for this if they are not.",
    ),
)


def _memory_option(holder: str) -> Callable[[Command], Command]:
    told = f"What {holder} may hold of a prepared volume, as 2G (half of what is left)."
    return headed(SERVERS, click.option("--memory", metavar="SIZE", callback=bytes_option, help=told))


memory_option = _memory_option("each server")
own_memory_option = _memory_option("this")
single_option = headed(
    SERVERS, click.option("--single", is_flag=True, help="One process, no servers: the same pictures.")
)
listen_options = headed(
    SERVERS,
    click.option(
        "--listen",
        metavar="HOST:PORT",
        callback=address_option,
        help="Wait here for servers started by hand, and start none.",
    ),
    click.option("--token-file", type=PATH, help="The session's token; made with --listen if missing."),
)
spawn_option = headed(
    SERVERS,
    click.option("--spawn", type=click.Choice(["local", "none"]), help="Start the servers here (local), or none."),
)
trace_option = headed(
    FILES,
    click.option("--trace", type=PATH, help="Write what every process does when, for chrome://tracing or Perfetto."),
)


@dataclass(frozen=True)
class Servers:
    """Which processes draw, and where they come from."""

    workers: int
    threads: int  # that the processes started here share out
    splat_servers: int = 1
    single: bool = False
    listen: Address | None = None
    by_hand: bool = False  # people start them, and they join at `listen`
    token: Token | None = None
    token_file: Path | None = None  # where it lies
    memory: int | None = None  # bytes of a prepared volume that each may hold
    silence: float = SILENCE_SECONDS  # after which one is lost
    tls: bool | None = None  # between machines
    cluster: Path | None = None  # whose servers are used, instead of all that is said of them here
    kept: KeptCluster | None = None  # that cluster, for several sessions in turn
    data_root: str | None = None  # folder outside of which those started here read nothing
    trace: Path | None = None  # file for what every process does when

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """What a command was given for those of the options above that it has. Raises BadInput.

        Makes the token file where --listen wants one that is missing.
        """
        asked = {field.name: given[field.name] for field in fields(cls) if field.name in given}
        servers = cls(**asked, by_hand=joined_by_hand(given))
        if servers.trace is not None:
            check_file_writable("--trace", servers.trace)
        if servers.cluster is not None:
            if servers.single or servers.listen:
                raise BadInput("--cluster says where the servers are; leave out --single and --listen")
            _refuse_given(
                _OF_SERVERS | {"threads": "--threads"}, "--cluster names a file that says this of its servers"
            )
            read_cluster(servers.cluster)
        if servers.single:
            _refuse_given(_OF_SERVERS | {"listen": "--listen"}, "--single starts no servers")
        if servers.by_hand:
            _refuse_given({"threads": "--threads"}, "--listen starts no servers, and each is told its own threads")
        return replace(servers, token=_shared_token(servers.token_file, makes=servers.listen is not None))

    @property
    def here(self) -> bool:
        """Whether they are this machine's, started for this command, and see its files."""
        return self.cluster is None and not self.by_hand

    def check_sees(self, volume: str) -> None:
        """Raises BadInput for a volume that is not there, where that is seen from here."""
        if self.here:
            check_is_there(volume)


def joined_by_hand(given: Mapping[str, Any]) -> bool:
    """Whether the options above say that people start the servers. Raises BadInput."""
    listens, spawn = given.get("listen") is not None, given.get("spawn")
    if spawn == "none" and not listens:
        raise BadInput("--spawn none needs --listen HOST:PORT, where the servers join")
    return listens and spawn != "local"


# What says how servers are started here, and is of no use without such.
_OF_SERVERS = {"workers": "--workers", "splat_servers": "--splat-servers", "silence": "--silence", "tls": "--tls"}


def _refuse_given(options: Mapping[str, str], why: str) -> None:
    """Raises BadInput if any of these parameters of the command that runs was given on its line."""
    of_command = click.get_current_context()
    for name, option in options.items():
        if of_command.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            raise BadInput(f"{why}; leave out {option}")


def _shared_token(token_file: Path | None, makes: bool) -> Token | None:
    """The token that the environment or the file gives; `makes` the file if there is none. None: no such wish."""
    if makes and token_file is not None and not token_file.exists():
        token = new_token()
        token.write(token_file)
        return token
    return find_token(os.environ, token_file)
