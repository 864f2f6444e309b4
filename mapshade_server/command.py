"""`volsplat mapshade-server`: joins a client and serves it until its session ends, and others after it if resident."""

from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import click

from volsplat.mapshade_server.held.memory_budget import MemoryBudget
from volsplat.mapshade_server.held.memory_promises import MemoryPromises
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.readers.reading.data_root import held_to
from volsplat.mapshade_server.server import MapShadeServer
from volsplat.program.clients import Clients
from volsplat.program.command_lines import HELP, PATH, examples
from volsplat.program.counts import Counts
from volsplat.program.server_process import (
    ServerOptions,
    bytes_option,
    client_options,
    log_as_asked,
    metrics_of,
    process_options,
)
from volsplat.program.this_machine import process_name
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.handshake import new_hello

EXAMPLE = examples("volsplat mapshade-server --connect desk:7411 --data-root /scratch --token-file session.token")


@click.command(
    "volsplat mapshade-server",
    epilog=EXAMPLE,
    context_settings=HELP,
)
@client_options
@click.option("--data-root", type=PATH, help="Read nothing outside; relative names start there.")
@click.option(
    "--memory",
    metavar="SIZE",
    callback=bytes_option,
    help="Most of a volume to hold, as 2G, if not prepared (what is left here).",
)
@process_options
def mapshade_server(data_root: Path | None, memory: int | None, **settings: Any) -> None:
    """Join a client, hold a sub-cube of its volume, and map and shade it for each frame."""
    log_as_asked("mapshade-server", settings)
    options, counts = ServerOptions.of(settings), Counts()
    with ExitStack() as stack:
        stack.enter_context(metrics_of(lambda: counts, options.metrics))
        budget = MemoryBudget(memory, MemoryPromises())  # whose file is opened before other places are closed off
        root = None if data_root is None else stack.enter_context(held_to(data_root))
        held = HeldVolume(budget)
        clients = stack.enter_context(closing(Clients(Role.MAPSHADE_SERVER, options)))

        def serve_one() -> bool:
            client = clients.next(new_hello(Role.MAPSHADE_SERVER, name=process_name(options.name)))
            try:
                return MapShadeServer(
                    client, options.token, options.threads, held, options.silence, root, options.encryption, counts
                ).run()
            finally:
                held.keep()

        clients.serve(serve_one)
