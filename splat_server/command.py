"""`volsplat splat-server`: joins a client and draws for it until its session ends."""

import logging
import os
from pathlib import Path

import click

from volsplat.program.log_lines import log_to_stderr
from volsplat.program.server_process import (
    THREADS,
    address_option,
    connect_option,
    patience_option,
    process_name,
    silence_option,
    token_file_option,
    verbose_option,
)
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import need_token
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.server import SplatServer

ANY_PORT = f"{LOOPBACK}:0"


@click.command("volsplat splat-server")
@connect_option
@click.option(
    "--listen",
    metavar="HOST:PORT",
    default=ANY_PORT,
    callback=address_option,
    help="Where map/shade servers reach this server (loopback, any free port).",
)
@token_file_option
@patience_option
@click.option("--threads", type=THREADS, default=usable_cores(), help="Threads that splat (cores).")
@silence_option
@verbose_option
def splat_server(
    client: Address,
    listen: Address,
    token_file: Path | None,
    patience: float,
    threads: int,
    silence: float,
    verbose: bool,
) -> None:
    """Join the client at HOST:PORT, merge and splat what its map/shade servers send, and hand out the image."""
    log_to_stderr("splat-server", logging.INFO if verbose else logging.WARNING)
    token = need_token(os.environ, token_file)
    invitations = Invitations(token)
    with Listener(
        Role.SPLAT_SERVER,
        token,
        host=listen.host,
        port=listen.port,
        token_of=invitations.token_of,
        allocate=BufferPool(),
    ) as data_links:
        # An address that means "every interface" is no address to dial: the client then names the one it sees.
        host = "" if data_links.address.host in ("0.0.0.0", "::") else data_links.address.host
        hello = new_hello(Role.SPLAT_SERVER, data_host=host, data_port=data_links.address.port, name=process_name())
        control = connect(client, hello, token, Role.CLIENT, patience=patience)
        SplatServer(control, data_links, invitations, threads, silence).run()
