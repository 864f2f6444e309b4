"""`volsplat splat-server`: joins a client and draws for it until its session ends, and others after it if resident."""

import os
from contextlib import closing
from ipaddress import ip_address
from pathlib import Path

import click

from volsplat.program.command_lines import HELP, examples
from volsplat.program.counts import Counts
from volsplat.program.server_process import (
    THREADS,
    address_option,
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
from volsplat.protocol.wire.addresses import LOOPBACK, Address, parse_address
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import need_token
from volsplat.splat_server.invitations import Invitations
from volsplat.splat_server.server import SplatServer

ANY_PORT = f"{LOOPBACK}:0"


EXAMPLE = examples("volsplat splat-server --connect desk:7411 --listen node1:7412 --token-file session.token")


@click.command(
    "volsplat splat-server",
    epilog=EXAMPLE,
    context_settings=HELP,
)
@client_options
@click.option(
    "--listen",
    metavar="HOST:PORT",
    default=ANY_PORT,
    callback=address_option,
    help="Where map/shade servers reach this server (loopback, any free port).",
)
@click.option(
    "--advertise",
    metavar="HOST[:PORT]",
    help="What map/shade servers are told to dial (where --listen is, or as the client sees this server).",
)
@click.option("--threads", type=THREADS, help="Threads that splat (cores).")
@sharing_option
@name_option
@tls_option
@silence_option
@metrics_options
@log_options
def splat_server(
    connect: Address | None,
    wait_at: Address | None,
    token_file: Path | None,
    patience: float,
    resident: bool,
    keep: float,
    listen: Address,
    advertise: str | None,
    threads: int | None,
    sharing: int,
    name: str,
    tls: bool | None,
    silence: float,
    metrics: Address | None,
    metrics_token: Path | None,
    verbose: bool,
    log_format: str,
) -> None:
    """Join a client, merge and splat what its map/shade servers send, and hand out the image."""
    log_as_asked("splat-server", verbose, log_format)
    counts, door = Counts(), checked_metrics(metrics, metrics_token)
    token = need_token(os.environ, token_file)
    with (
        metrics_of(lambda: counts, metrics, door),
        closing(clients_of(Role.SPLAT_SERVER, token, connect, wait_at, patience, resident, keep, tls)) as clients,
    ):

        def serve_one() -> bool:
            invitations = Invitations(token)
            with Listener(
                Role.SPLAT_SERVER,
                token,
                host=listen.host,
                port=listen.port,
                token_of=invitations.token_of,
                allocate=BufferPool(),
                encryption=Encryption.of(tls),
            ) as data_links:
                host, port = told_address(data_links.address, advertise)
                hello = new_hello(Role.SPLAT_SERVER, data_host=host, data_port=port, name=process_name(name))
                client, owners = clients.next(hello), threads_of(threads, sharing)
                return SplatServer(client, data_links, invitations, owners, silence, counts).run()

        clients.serve(serve_one)


def told_address(listening: Address, advertise: str | None) -> Address:
    """What the client tells map/shade servers to dial; no host means whichever they reach this server by.

    Raises BadInput for an `advertise` that is no address.
    """
    if advertise is not None:
        return parse_address(advertise if ":" in advertise.rpartition("]")[2] else f"{advertise}:{listening.port}")
    return listening._replace(host="") if ip_address(listening.host).is_unspecified else listening
