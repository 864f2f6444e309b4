"""`volsplat mapshade-server`: joins a client and serves it until its session ends, and others after it if resident."""

import logging
import os
from contextlib import closing
from pathlib import Path

import click

from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.server import MapShadeServer
from volsplat.program.log_lines import log_to_stderr
from volsplat.program.server_process import (
    THREADS,
    client_options,
    clients_of,
    process_name,
    sharing_option,
    silence_option,
    threads_of,
    verbose_option,
)
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.tokens import need_token


@click.command("volsplat mapshade-server")
@client_options
@click.option("--threads", type=THREADS, help="Threads that walk (cores).")
@sharing_option
@click.option("--data-root", type=click.Path(path_type=Path), help="Folder that relative names of volumes start from.")
@silence_option
@verbose_option
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
    silence: float,
    verbose: bool,
) -> None:
    """Join a client, hold a sub-cube of its volume, and map and shade it for each frame."""
    log_to_stderr("mapshade-server", logging.INFO if verbose else logging.WARNING)
    token = need_token(os.environ, token_file)
    if data_root is not None:
        _enter(data_root)
    held = HeldVolume()
    with closing(clients_of(Role.MAPSHADE_SERVER, token, connect, wait_at, patience, resident, keep)) as clients:

        def serve_one() -> None:
            client = clients.next(new_hello(Role.MAPSHADE_SERVER, name=process_name()))
            try:
                MapShadeServer(client, token, threads_of(threads, sharing), held, silence).run()
            finally:
                held.keep()

        clients.serve(serve_one)


def _enter(data_root: Path) -> None:
    try:
        os.chdir(data_root.expanduser())
    except OSError as error:
        raise BadInput(f"--data-root {data_root}: {error.strerror}; name a folder of this machine") from error
