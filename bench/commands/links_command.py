"""`volsplat bench links`: what a link carries on one machine, by each way that links go, and what TLS costs."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click

from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure, record
from volsplat.bench.tables.text_table import TextTable, significant
from volsplat.client.command.help_page import helped
from volsplat.deploy.server_command import Program, server_command
from volsplat.program.extras import need
from volsplat.protocol.messages.link_messages import LARGEST_MEASURE, LinkMeasured, MeasureLink
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost
from volsplat.protocol.wire.addresses import LOOPBACK
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import UNTAKEN, Heartbeat
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token

if TYPE_CHECKING:
    import psutil

BY_TCP = "127.0.0.2"  # loopback too, where no Unix socket is beside the port
WAYS = {
    "Unix socket": (LOOPBACK, Encryption.NEVER),
    "TCP": (BY_TCP, Encryption.NEVER),
    "TCP with TLS 1.3": (BY_TCP, Encryption.ALWAYS),
}
JOIN_SECONDS = 60.0
GB = 1e9


@dataclass
class Way:
    """A link to a server of its own, and what it took so far."""

    name: str
    server: Connection
    process: psutil.Process
    there: list[float] = field(default_factory=list)  # seconds of LARGEST_MEASURE
    back: list[float] = field(default_factory=list)  # likewise
    nothing: list[float] = field(default_factory=list)  # seconds there and back
    own_seconds: float = 0.0  # of processor time
    server_seconds: float = 0.0

    def round(self) -> None:
        own, other = time.process_time(), self._server_seconds()
        self.there.append(self._asked(LARGEST_MEASURE, 0))
        self.back.append(self._asked(0, LARGEST_MEASURE))
        self.own_seconds += time.process_time() - own
        self.server_seconds += self._server_seconds() - other
        self.nothing.append(self._asked(0, 0))

    def _asked(self, sent: int, wanted: int) -> float:
        payload, began = bytes(sent), time.perf_counter()
        self.server.send(MeasureLink(sent=sent, wanted=wanted), payload)
        received = self.server.receive()
        if received is None or not isinstance(received.message, LinkMeasured):
            raise PeerLost(f"{self.server} does not answer")
        return time.perf_counter() - began

    def _server_seconds(self) -> float:
        used = self.process.cpu_times()
        return float(used.user + used.system)


@helped("volsplat bench links")
@click.option("--rounds", type=click.IntRange(min=1), default=200, help="Of 4 MiB either way, by each way (200).")
@output_options()
def links(rounds: int, **settings: Any) -> None:
    """Send bytes to splat servers and back, by a Unix socket, by TCP and by TLS, in turns.

    Both ends are on this machine, so that a link's rate is what two cores make of it. Between machines, divide the
    processor time of a GB by the network's seconds for one: that is the part of a core that each end needs.
    """
    need("psutil", "this benchmark", "bench")
    outputs = Outputs.of(settings)
    table = TextTable(
        "Links between two processes of this machine",
        ("link", "GB/s to it", "GB/s from it", "CPU s/GB, this end", "CPU s/GB, other end", "there and back, µs"),
        f"Medians of {rounds} rounds in turns, {LARGEST_MEASURE >> 20} MiB either way; processor time of all.",
    )
    with ExitStack() as stack:
        ways = [stack.enter_context(_opened(name)) for name in WAYS]
        with shown_progress("links", rounds) as step:
            for _ in range(rounds):
                for way in ways:
                    way.round()
                step()
    figures = [one for way in ways for one in _figures(way)]
    for n, way in enumerate(ways):
        there, back, own, other, nothing = (one.median for one in figures[5 * n : 5 * n + 5])
        rates = (LARGEST_MEASURE / seconds / GB for seconds in (there, back))
        table.add(way.name, *map(significant, (*rates, own, other, nothing * 1e6)))
    outputs.deliver(record("links", {"bytes": str(LARGEST_MEASURE)}, figures), [table])


def _figures(way: Way) -> list[Figure]:
    carried = 2 * len(way.there) * LARGEST_MEASURE / GB
    return [
        figure(f"{way.name}: to it", "s", way.there),
        figure(f"{way.name}: from it", "s", way.back),
        figure(f"{way.name}: processor time of a GB, this end", "s", [way.own_seconds / carried]),
        figure(f"{way.name}: processor time of a GB, other end", "s", [way.server_seconds / carried]),
        figure(f"{way.name}: there and back", "s", way.nothing),
    ]


@contextmanager
def _opened(name: str) -> Iterator[Way]:
    import psutil

    host, encryption = WAYS[name]
    token = new_token()
    with Listener(Role.CLIENT, token, host=host, encryption=encryption) as listener:
        command = server_command(Program.SPLAT_SERVER, "--connect", str(listener.address), *encryption.options)
        with subprocess.Popen(command, env=token.added_to(os.environ), stdin=subprocess.DEVNULL) as process:
            heartbeat = Heartbeat()
            try:
                server = listener.accept(JOIN_SECONDS)
                if server is None:
                    raise PeerLost(f"the splat server has not joined for {JOIN_SECONDS:g} s")
                server.lose_after(UNTAKEN * heartbeat.silence)
                heartbeat.keep(server, lambda: heartbeat.silence)
                yield Way(name, server, psutil.Process(process.pid))
                server.close()
            finally:
                heartbeat.close()
                process.terminate()
