"""`volsplat mapshade-server`: joins a client and serves it until its session ends."""

import logging
import os
from pathlib import Path

import click

from volsplat.mapshade_server.server import MapShadeServer
from volsplat.program.log_lines import log_to_stderr
from volsplat.program.server_process import (
    THREADS,
    connect_option,
    patience_option,
    process_name,
    silence_option,
    token_file_option,
    verbose_option,
)
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.tokens import need_token


@click.command("volsplat mapshade-server")
@connect_option
@token_file_option
@patience_option
@click.option("--threads", type=THREADS, default=usable_cores(), help="Threads that walk (cores).")
@silence_option
@verbose_option
def mapshade_server(
    client: Address, token_file: Path | None, patience: float, threads: int, silence: float, verbose: bool
) -> None:
    """Join the client at HOST:PORT, hold a sub-cube of its volume, and map and shade it for each frame."""
    log_to_stderr("mapshade-server", logging.INFO if verbose else logging.WARNING)
    token = need_token(os.environ, token_file)
    hello = new_hello(Role.MAPSHADE_SERVER, name=process_name())
    connection = connect(client, hello, token, Role.CLIENT, patience=patience, allocate=BufferPool())
    MapShadeServer(connection, token, threads, silence).run()
