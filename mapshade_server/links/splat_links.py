"""The links to all splat servers that the client names."""

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from volsplat.mapshade_server.links.data_link import DataLink
from volsplat.protocol.messages.messages import Route
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.closed_tiles import new_tile_map
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.heartbeat import Heartbeat
from volsplat.protocol.wire.tokens import Token

log = logging.getLogger(__name__)

MOST_DIALLED = 32  # at once
CLIENT_FIRST = 2.0  # times the silence: the client, which knows more, judges a splat server that is frozen before


class SplatLinks:
    """One thread connects and closes; any other may interrupt."""

    def __init__(
        self,
        token: Token,
        given_up: Callable[[], bool],
        heartbeat: Heartbeat,
        encryption: Encryption,
        walkers: int = 1,
    ) -> None:
        """For the batches of so many walkers. Dialling ends where it is `given_up`."""
        self._walkers = walkers
        self._heartbeat = heartbeat
        self._token = token
        self._encryption = encryption
        self._given_up = given_up
        self._links: dict[int, DataLink] = {}  # by splat server; replaced, never changed
        self._wanted: Sequence[Route] | None = None  # of the newest request, which may still wait; None before any

    @property
    def of_servers(self) -> Mapping[int, DataLink]:
        return self._links

    def connect(self, routes: Sequence[Route], server: int) -> None:
        """Have this server linked to the ends of these routes and to no other.

        All are dialled at once, and one that cannot be reached is done without. Raises what the first one failed of if
        none can.
        """
        kept = {link.route: link for link in self._links.values() if not link.closed and link.route in routes}
        unreached: VolsplatError | None = None
        before, self._links = self._links, {route.server: link for route, link in kept.items()}
        for link in before.values():
            if link not in kept.values():
                link.close()
        new = [route for route in routes if route not in kept]
        with ThreadPoolExecutor(MOST_DIALLED, "dial splat server") as dialling:
            dialled = [(route, dialling.submit(self._link, route, server)) for route in new]
            for route, link_to in dialled:
                try:
                    self._links = {**self._links, route.server: link_to.result()}
                except VolsplatError as error:
                    log.info("%s", error)
                    unreached = unreached or error
        if unreached and not self._links:
            raise unreached

    def _link(self, route: Route, server: int) -> DataLink:
        address, hello = Address(route.host, route.port), new_hello(Role.DATA_LINK, server=server)
        token = self._token.bound_to(route.key)
        connection = connect(
            address,
            hello,
            token,
            Role.SPLAT_SERVER,
            server=route.server,
            encryption=self._encryption,
            handshake_seconds=CLIENT_FIRST * self._heartbeat.silence,  # one that is frozen takes what is dialled
            report=lambda error: log.info("%s; trying again", error),
            given_up=lambda: self._given_up() or self._is_unwanted(route),
        )
        self._heartbeat.keep(connection, lambda: CLIENT_FIRST * self._heartbeat.silence)
        return DataLink(route, connection, self._walkers)

    def _is_unwanted(self, route: Route) -> bool:
        return self._wanted is not None and route not in self._wanted

    def begin_frame(self, frame: int, plan: FramePlan, paced_walkers: int) -> memoryview:
        """The map of closed tiles of a frame's image, which every splat server has filled from now on for its lines.

        `paced_walkers` are held back where a link is slow (see link_pace).
        """
        tile_map = new_tile_map(plan.width, plan.height)
        for link in self._links.values():
            link.begin_frame(frame, plan, tile_map, paced_walkers)
        return tile_map

    def interrupt(self) -> None:
        """Close them from any thread: whoever sends is woken."""
        self.interrupt_except(())

    def interrupt_except(self, routes: Sequence[Route]) -> None:
        """Likewise, but for those to the ends of these routes; no other is dialled again."""
        self._wanted = routes
        for link in self._links.values():
            if link.route not in routes:
                link.interrupt()

    def close(self) -> None:
        for link in self._links.values():
            link.close()
        self._links = {}
