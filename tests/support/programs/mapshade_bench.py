"""A map/shade server in a thread, over real sockets, with the test as its client and as its splat servers.

The system gives no memory to be shared, so that batches come by the sockets.
"""

import os
import threading
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import pytest

from support.patience import PATIENCE
from support.scenes.phantoms import QUANTISATION, shaded_scene
from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.mapshade_server.server import MapShadeServer
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.levels import own_resolution
from volsplat.protocol.rules.line_of_sight import line_of_sight, sight_plan
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token

SCENE = shaded_scene(View(zoom=3.0), (64, 48))
KEY = bytes(range(messages.WORKER_KEY_BYTES))


class Bench:
    """A map/shade server in a thread, what a client says to it, and where splat servers would listen."""

    def __init__(self, allocate: Allocate = new_buffer) -> None:
        self._system = pytest.MonkeyPatch()
        self._system.setattr(os, "memfd_create", _refuse)
        self.token = new_token()
        self._clients = Listener(Role.CLIENT, self.token)
        links = self.token.bound_to(KEY)
        self.splat_servers = [Listener(Role.SPLAT_SERVER, self.token, token_of=lambda _: links) for _ in range(2)]
        hello = new_hello(Role.MAPSHADE_SERVER)
        self.connection = connect(self._clients.address, hello, self.token, Role.CLIENT, allocate=allocate)
        self._server = MapShadeServer(self.connection, self.token, threads=1, silence=PATIENCE)
        self.failure: VolsplatError | None = None  # of the server
        self._thread = threading.Thread(target=self._run, name="map/shade server under test", daemon=True)
        self._thread.start()
        control = self._clients.accept(PATIENCE)
        assert control is not None
        self.control: Connection = control

    @property
    def waiting(self) -> list[messages.Message]:
        """Requests that the server has received and not begun."""
        return [received.message for received in self._server._requests._waiting]

    @property
    def linked(self) -> list[int]:
        """Splat servers that the server has not lost."""
        return [server for server, link in self._server._links.of_servers.items() if not link.closed]

    @property
    def heard(self) -> int:
        """How many messages splat servers have got through to the server."""
        return sum(link.counters.messages_in for link in self._server._links.of_servers.values())

    def _run(self) -> None:
        try:
            self._server.run()
        except VolsplatError as error:
            self.failure = error

    def hears(self, kind: type[messages.Message]) -> messages.Message:
        received = self.control.receive()
        assert received is not None and isinstance(received.message, kind), received
        return received.message

    def refuses(self, request: messages.Message) -> messages.Refused:
        self.control.send(request)
        refused = self.hears(messages.Refused)
        assert isinstance(refused, messages.Refused) and refused.request == type(request).__name__
        return refused

    def connects(self, *numbers: int) -> None:
        """Have the server link to these splat servers."""
        addresses = {number: self.splat_servers[number].address for number in numbers}
        routes = [messages.Route(2 + number, address.host, address.port, KEY) for number, address in addresses.items()]
        self.control.send(messages.ConnectToSplatServers(routes=routes))
        self.hears(messages.ConnectedToSplatServers)

    def accepts(self, number: int) -> Connection:
        """The data link that a splat server gets."""
        link = self.splat_servers[number].accept(PATIENCE)
        assert link is not None
        return link

    def holds(self, path: Path, assignment: int) -> Geometry:
        """Have the server read and pack the whole volume."""
        self.control.send(messages.DescribeVolume(str(path)))
        described = self.hears(messages.VolumeDescribed)
        assert isinstance(described, messages.VolumeDescribed)
        geometry = described.description.geometry
        self.control.send(messages.ReadSubCubes(assignment, str(path), [geometry.box], described.identity))
        self.hears(messages.SubCubesRead)
        self.control.send(messages.PackVoxels(assignment, QUANTISATION))
        self.hears(messages.VoxelsPacked)
        return geometry

    def draws(self, frame: int, geometry: Geometry, link: Connection, server: int = 2) -> None:
        """A whole frame, whose batches come over this link."""
        self.control.send(render(frame, geometry, owners={server: 1}))
        self.hears(messages.FrameMapped)
        sequence, last = 0, False
        while not last:
            received = link.receive()
            assert received is not None and isinstance(received.message, messages.Batch)
            batch = received.message
            assert (batch.frame, batch.sequence) == (frame, sequence)
            sequence, last = sequence + 1, batch.last

    def ends(self) -> None:
        """Wait until the server has ended."""
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def close(self) -> None:
        if not self.control.closed:
            self.control.send(messages.EndSession())
        self.ends()
        self.control.close()
        for listener in (self._clients, *self.splat_servers):
            listener.close()
        self._system.undo()


def _refuse(*_: object) -> None:
    raise OSError("no memory is left")


def render(
    frame: int,
    geometry: Geometry,
    scene: Scene = SCENE,
    assignment: int = 1,
    walkers: int = 1,
    owners: Mapping[int, int] = MappingProxyType({2: 1}),
) -> messages.RenderFrame:
    drawing = Drawing.planned(scene, Step.F, geometry, QUANTISATION, own_resolution(geometry, Step.F))
    regions = RegionShares().regions(drawing.plan, owners)
    return messages.RenderFrame(frame, assignment, drawing, {1: walkers}, regions, exact=True)


def probe(geometry: Geometry, scene: Scene, assignment: int = 1) -> messages.ProbeVoxels:
    width, height = scene.image.width, scene.image.height
    line = line_of_sight(scene, geometry, (width - 1) / 2, (height - 1) / 2)
    return messages.ProbeVoxels(
        1, assignment, line, Drawing.of(scene, sight_plan(scene, geometry), geometry, QUANTISATION)
    )
