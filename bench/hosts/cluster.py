"""A session whose servers run on the hosts of a small lab, one on each: what a cluster of so many machines does."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from volsplat.bench.hosts.namespaces import Host, lab
from volsplat.client.session.session import Session
from volsplat.deploy.server_command import Program, server_command
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.tokens import Token, new_token


@contextmanager
def cluster_of_hosts(
    path: str,
    workers: int,
    splat_servers: int,
    bits_per_second: float,
    say: Callable[[str], None],
    trace: Path | None = None,
) -> Iterator[Session]:
    """The volume held by so many hosts with a map/shade server and others with a splat server; the client has its own.

    `trace`: see Session. Raises BadInput where there can be no lab.
    """
    token = new_token()
    with lab(1 + workers + splat_servers, bits_per_second) as (client, *hosts):
        listen = Address(client.address, 0)
        with Session(
            path,
            workers=workers,
            splat_servers=splat_servers,
            listen=listen,
            spawn=False,
            token=token,
            trace=trace,
            on_progress=say,
        ) as session:
            programs = [Program.MAPSHADE_SERVER] * workers + [Program.SPLAT_SERVER] * splat_servers
            with _running(hosts, programs, session, token):
                assert session.volume, "wait until its servers have read the volume"
                yield session


@contextmanager
def _running(hosts: Sequence[Host], programs: Sequence[Program], session: Session, token: Token) -> Iterator[None]:
    """These servers, each on its host, with one thread. One that ends before its session ends that."""
    environment = token.added_to(os.environ)
    with ExitStack() as ended:
        for host, program in zip(hosts, programs, strict=True):
            options = ["--connect", str(session.address), "--threads", "1"]
            if program == Program.SPLAT_SERVER:
                options += ["--listen", str(Address(host.address, 0))]
            server = host.start(server_command(program, *options), environment)
            watcher = threading.Thread(target=_close_with, args=(server, session), daemon=True)
            ended.callback(watcher.join)
            ended.callback(server.kill)
            watcher.start()
        yield
        session.close()


def _close_with(server: subprocess.Popen[bytes], session: Session) -> None:
    server.wait()
    session.close()
