"""`volsplat splat-server`: joins a client and draws for it until its session ends, and others after it if resident."""

from contextlib import closing
from ipaddress import ip_address
from typing import Any

import click

from volsplat.program.clients import Clients
from volsplat.program.command_lines import HELP, examples
from volsplat.program.counts import Counts
from volsplat.program.server_process import (
    ServerOptions,
    address_option,
    client_options,
    log_as_asked,
    metrics_of,
    process_options,
)
from volsplat.program.this_machine import process_name
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.addresses import LOOPBACK, Address, parse_address
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
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
@process_options
def splat_server(listen: Address, advertise: str | None, **settings: Any) -> None:
    """Join a client, merge and splat what its map/shade servers send, and hand out the image."""
    log_as_asked("splat-server", settings)
    options, counts = ServerOptions.of(settings), Counts()
    with (
        metrics_of(lambda: counts, options.metrics),
        closing(Clients(Role.SPLAT_SERVER, options)) as clients,
    ):

        def serve_one() -> bool:
            invitations = Invitations(options.token)
            with Listener(
                Role.SPLAT_SERVER,
                options.token,
                host=listen.host,
                port=listen.port,
                token_of=invitations.token_of,
                allocate=BufferPool(),
                encryption=options.encryption,
            ) as data_links:
                host, port = told_address(data_links.address, advertise)
                hello = new_hello(Role.SPLAT_SERVER, data_host=host, data_port=port, name=process_name(options.name))
                client, threads = clients.next(hello), options.threads
                return SplatServer(client, data_links, invitations, threads, options.silence, counts).run()

        clients.serve(serve_one)


def told_address(listening: Address, advertise: str | None) -> Address:
    """What the client tells map/shade servers to dial; no host means whichever they reach this server by.

    Raises BadInput for an `advertise` that is no address.
    """
    if advertise is not None:
        return parse_address(advertise if ":" in advertise.rpartition("]")[2] else f"{advertise}:{listening.port}")
    return listening._replace(host="") if ip_address(listening.host).is_unspecified else listening
