"""The servers of a session: who is there, who shares the volume and the image, who was lost with a part of either."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace

from volsplat.client.coordinator.events.events import ServerJoined
from volsplat.client.coordinator.server_states import ServerState, missing_boxes
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.session_messages import MachineDescribed

MOST_LOSSES = 2  # of one process that joins again each time, without a part in a whole frame between
KEPT_OUT = 20  # whole frames of others, before one that was lost so often gets a part again; twice as many each time
LOST_AGAIN = (
    "it joins and is lost again and again, and gets no part for a while where others draw; "
    "if small messages get through and large ones do not, check the network's MTU"
)


class Servers:
    """`states` holds those that are there, and those that were lost after they had been chosen."""

    def __init__(self) -> None:
        self.joined: dict[int, ServerJoined] = {}  # those that are there
        self.states: dict[int, ServerState] = {}  # replaced whole, for other threads
        self.workers: list[int] = []  # those that were chosen to hold the volume's sub-cubes
        self._unlinked: set[str] = set()  # processes that no splat server could be reached from
        self._losses: Counter[str] = Counter()  # of processes, since they had a part in a whole frame
        self._kept_out: Counter[str] = Counter()  # processes, for so many frames
        self._handing_over: list[int] = []  # lost servers whose parts were handed over last
        self._boxes: dict[int, list[Box]] = {}  # what was noted last of who holds what
        self.leaving: list[int] = []  # those that were told to end, and are still there
        self.splat_servers: list[int] = []  # those that draw, as long as they are there

    @property
    def missing(self) -> tuple[Box, ...]:
        """The parts of the volume that were lost with their servers."""
        return missing_boxes(self.states.values())

    @property
    def owners(self) -> dict[int, int]:
        """The splat servers that draw, each with the number of its threads that may own a region."""
        return {server: self.states[server].threads for server in self.splat_servers}

    def ready(self, role: Role) -> list[int]:
        """Those of a role that have told what they have, in an order that is the same for each of their clients.

        Those that are lost again and again are the last.
        """
        of_role = [n for n, joined in self.joined.items() if joined.role == role and self.states[n].is_known]
        return sorted(of_role, key=lambda n: (self._is_unsteady(n), self.joined[n].process, n))

    def _is_unsteady(self, server: int) -> bool:
        return self._kept_out[self.joined[server].process] > 0

    @property
    def all_are_known(self) -> bool:
        """Whether all that are there have told what they have. Soon they will, or be lost."""
        return all(self.states[n].is_known for n in self.joined)

    def name(self, server: int) -> str:
        return self.joined[server].name

    def add(self, joined: ServerJoined) -> None:
        self.joined[joined.server] = joined
        self.note([ServerState(joined.server, joined.role, joined.host, by_hand=joined.by_hand)])

    def note(self, states: Iterable[ServerState]) -> None:
        if noted := {state.id: state for state in states}:
            self.states = self.states | noted

    def hold(self, boxes: Mapping[int, list[Box]]) -> None:
        """These hold parts of the volume, or will when what is on its way is there."""
        if boxes != self._boxes:
            self._boxes = dict(boxes)
            told = ((self.states[server], tuple(held)) for server, held in boxes.items())
            self.note(replace(state, boxes=held) for state, held in told if state.boxes != held)

    def describe(self, server: int, machine: MachineDescribed) -> None:
        state = self.states[server]
        self.note([replace(state, threads=machine.threads, memory_bytes=machine.memory_bytes)])

    def idle(self) -> list[int]:
        """Map/shade servers that hold nothing, and could.

        One that could not link, and joins again, is tried again only if no other is left: each try may hold up
        frames for as long as a firewall lets it wait. So it is for a while with one that is lost again and again.
        """
        idle = [n for n in self.ready(Role.MAPSHADE_SERVER) if n not in self.workers]
        return [n for n in idle if not (self._is_unlinked(n) or self._is_unsteady(n)) or not self.chosen]

    def _is_unlinked(self, server: int) -> bool:
        return self.joined[server].process in self._unlinked

    def drew_whole(self, workers: Iterable[int]) -> None:
        """These had a part in a frame that is whole."""
        for worker in workers:
            self._losses.pop(self.joined[worker].process, None)
        self._kept_out = +(self._kept_out - Counter(list(self._kept_out)))

    def note_unlinked(self, server: int) -> None:
        """It cannot link to any splat server."""
        self._unlinked.add(self.joined[server].process)

    def doubt_heirs(self, server: int) -> None:
        """Whether others can do its work is not known yet."""
        self.note([replace(self.states[server], heirs=False)])

    def draw_with(self, splat_server: int) -> None:
        """There is one more, to which all may link."""
        self.splat_servers = [*self.splat_servers, splat_server]
        self._unlinked.clear()

    @property
    def chosen(self) -> list[int]:
        """Map/shade servers that were chosen, and are still there."""
        return [n for n in self.workers if n in self.joined]

    def hand_over(self) -> None:
        """What is missing is being read by others."""
        self._handing_over = self._without_heirs()
        self.note(replace(self.states[n], handed_over=True, why_missing="") for n in self._handing_over)

    def take_back(self) -> None:
        """What was handed over last is missing, after all."""
        self.note(replace(self.states[n], handed_over=False) for n in self._handing_over)

    def note_missing(self, why: str) -> None:
        """Why nobody takes over what is missing; empty if somebody may, after all."""
        self.note(replace(self.states[n], why_missing=why) for n in self._without_heirs())

    def _without_heirs(self) -> list[int]:
        return [n for n, state in self.states.items() if missing_boxes([state])]

    def lose(self, server: int, cause: str) -> ServerState | None:
        """It is gone. Its state, if the session needed it: then that is kept."""
        joined = self.joined.pop(server, None)
        if joined is None:
            return None
        self.leaving = [n for n in self.leaving if n != server]
        if server not in (*self.splat_servers, *self.workers):
            self.states = {n: state for n, state in self.states.items() if n != server}
            return None
        self.splat_servers = [n for n in self.splat_servers if n != server]
        cause += self._lost_again(joined.process)
        role = self.states[server].role
        alone = all(other.role is not role for other in self.joined.values())
        lost = replace(self.states[server], lost=True, cause=cause, alone=alone)
        self.note([lost])
        return lost

    def _lost_again(self, process: str) -> str:
        """Note the loss of what a process had; what to tell of it beside the cause, once."""
        if not process:
            return ""
        self._losses[process] += 1
        often = self._losses[process] - MOST_LOSSES
        if often >= 0:
            self._kept_out[process] = KEPT_OUT << min(often, 10)
        return f"; {LOST_AGAIN}" if often == 0 else ""

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        present = {n for n, state in self.states.items() if not state.lost}
        assert present == self.joined.keys(), "the states are not those of the servers that are there"
        known = {n for n in present if self.states[n].is_known}
        assert set(self.splat_servers) <= known, "a splat server draws that is gone, or unknown"
        assert set(self.leaving) <= present, "a server is to be let go that is gone"
        assert all(state.lost == bool(state.cause) for state in self.states.values()), "a loss without a cause"
