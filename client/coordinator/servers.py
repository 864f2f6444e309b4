"""The servers of a session: who is there, who shares the volume, who was lost with a part of it."""

from collections.abc import Iterable
from dataclasses import replace

from volsplat.client.coordinator.coordinator_events import ServerJoined
from volsplat.client.coordinator.server_states import ServerState, missing_boxes
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.roles import Role


class Servers:
    """`states` holds those that are there, and those that were lost with a part of the volume."""

    def __init__(self) -> None:
        self.joined: dict[int, ServerJoined] = {}  # those that are there
        self.states: dict[int, ServerState] = {}  # replaced whole, for other threads
        self.workers: list[int] = []  # those that were chosen to hold the volume's sub-cubes
        self.splat = 0  # the one that draws

    @property
    def missing(self) -> tuple[Box, ...]:
        """The parts of the volume that were lost with their servers."""
        return missing_boxes(self.states.values())

    def of_role(self, role: Role) -> list[int]:
        return sorted(n for n, server in self.joined.items() if server.role == role)

    def name(self, server: int) -> str:
        return self.joined[server].name

    def add(self, joined: ServerJoined) -> None:
        self.joined[joined.server] = joined
        self.note([ServerState(joined.server, joined.role, joined.host)])

    def note(self, states: Iterable[ServerState]) -> None:
        self.states = self.states | {state.id: state for state in states}

    def lose(self, server: int, cause: str) -> ServerState | None:
        """It is gone. Its state, if the session needed it: then that is kept."""
        if self.joined.pop(server, None) is None:
            return None
        if server != self.splat and server not in self.workers:
            self.states = {n: state for n, state in self.states.items() if n != server}
            return None
        lost = replace(self.states[server], lost=True, cause=cause)
        self.note([lost])
        return lost

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        present = {n for n, state in self.states.items() if not state.lost}
        assert present == self.joined.keys(), "the states are not those of the servers that are there"
        assert all(state.lost == bool(state.cause) for state in self.states.values()), "a loss without a cause"
