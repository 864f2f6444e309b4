"""Whether each map/shade server reaches each splat server, which it sends packets to."""

import secrets
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from volsplat.deploy.cluster.state import KnownServer
from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.doctor.meeting import Meeting
from volsplat.deploy.server_command import Program
from volsplat.protocol.messages.session_messages import (
    WORKER_KEY_BYTES,
    ConnectedToSplatServers,
    ConnectToSplatServers,
    InviteWorkers,
    Route,
)
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.addresses import Address, reached_from
from volsplat.protocol.wire.connection import Connection


def packet_links(there: Mapping[str, tuple[KnownServer, Connection]], meeting: Meeting) -> Iterator[Finding]:
    workers = {name: server for name, (one, server) in there.items() if one.program is Program.MAPSHADE_SERVER}
    splats = {name: server for name, (one, server) in there.items() if one.program is Program.SPLAT_SERVER}
    keys = {worker.peer.id: secrets.token_bytes(WORKER_KEY_BYTES) for worker in workers.values()}
    for splat in splats.values():
        with suppress(VolsplatError):  # one that is lost is found so by whoever dials it
            splat.send(InviteWorkers(keys=keys))

    def of_worker(name: str) -> list[Finding]:
        worker = workers[name]
        key = keys[worker.peer.id]
        return [_link(name, worker, other, _route(worker, splat, key), meeting) for other, splat in splats.items()]

    if not workers:
        return
    pool = ThreadPoolExecutor(len(workers), "packet links")  # each waits where ports are closed
    try:
        for found in pool.map(of_worker, workers):
            yield from found
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # what still waits ends with its connection


def _route(worker: Connection, splat: Connection, key: bytes) -> Route:
    data = Address(splat.peer.data_host, splat.peer.data_port)
    reached = reached_from(data, splat.peer.data_anywhere, worker.peer.host, worker.local_host)
    return Route(server=splat.peer.id, host=reached.host, port=reached.port, key=key)


def _link(name: str, worker: Connection, splat: str, route: Route, meeting: Meeting) -> Finding:
    try:
        meeting.ask(worker, ConnectToSplatServers([route]), ConnectedToSplatServers)
    except VolsplatError as error:
        cure = "open that port, or give the splat server's machine: advertise"
        return Finding(name, "packets", right=False, line=f"do not reach {splat}: {error}; {cure}")
    return Finding(name, "packets", right=True, line=f"reach {splat} at {Address(route.host, route.port)}")
