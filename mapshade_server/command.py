"""`volsplat mapshade-server`: joins a client and serves it until its session ends, and others after it if resident."""

import os
from contextlib import ExitStack, closing
from pathlib import Path

import click

from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.readers.reading.data_root import held_to
from volsplat.mapshade_server.server import MapShadeServer
from volsplat.program.command_lines import HELP, examples
from volsplat.program.counts import Counts
from volsplat.program.memory_budget import MemoryBudget
from volsplat.program.memory_promises import MemoryPromises
from volsplat.program.server_process import (
    THREADS,
    checked_metrics,
    client_options,
    clients_of,
    log_as_asked,
    log_options,
    metrics_of,
    metrics_options,
    name_option,
    sharing_option,
    silence_option,
    threads_of,
    tls_option,
)
from volsplat.program.this_machine import process_name
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.byte_sizes import bytes_from_option
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.tokens import need_token

EXAMPLE = examples("volsplat mapshade-server --connect desk:7411 --data-root /scratch --token-file session.token")


@click.command(
    "volsplat mapshade-server",
    epilog=EXAMPLE,
    context_settings=HELP,
)
@client_options
@click.option("--threads", type=THREADS, help="Threads that walk (cores).")
@sharing_option
@click.option("--data-root", type=click.Path(path_type=Path), help="Read nothing outside; relative names start there.")
@click.option("--memory", metavar="SIZE", help="Most of a volume to hold, as 2G, if not prepared (what is left here).")
@name_option
@tls_option
@silence_option
@metrics_options
@log_options
def mapshade_server(
    connect: Address | None,
    wait_at: Address | None,
    token_file: Path | None,
    patience: float,
    resident: bool,
    keep: float,
    threads: int | None,
    sharing: int,
    data_root: Path | None,
    memory: str | None,
    name: str,
    tls: bool | None,
    silence: float,
    metrics: Address | None,
    metrics_token: Path | None,
    verbose: bool,
    log_format: str,
) -> None:
    """Join a client, hold a sub-cube of its volume, and map and shade it for each frame."""
    log_as_asked("mapshade-server", verbose, log_format)
    counts, door = Counts(), checked_metrics(metrics, metrics_token)
    limit = None if memory is None else bytes_from_option("--memory", memory)
    token = need_token(os.environ, token_file)
    with ExitStack() as stack:
        stack.enter_context(metrics_of(lambda: counts, metrics, door))
        budget = MemoryBudget(limit, MemoryPromises())  # whose file is opened before other places are closed off
        root = None if data_root is None else stack.enter_context(held_to(data_root))
        held = HeldVolume(budget=budget)
        clients = clients_of(Role.MAPSHADE_SERVER, token, connect, wait_at, patience, resident, keep, tls)
        stack.enter_context(closing(clients))

        def serve_one() -> bool:
            client = clients.next(new_hello(Role.MAPSHADE_SERVER, name=process_name(name)))
            try:
                return MapShadeServer(
                    client, token, threads_of(threads, sharing), held, silence, root, Encryption.of(tls), counts
                ).run()
            finally:
                held.keep()

        clients.serve(serve_one)
