"""Assignments of sub-cubes: the one that is held or on its way, who refused it, and what was held before."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from volsplat.client.coordinator.holding.packing import Packing
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import VolsplatError


@dataclass(frozen=True)
class Held:
    """What all servers hold: of assignment 0 nothing."""

    assignment: int
    packing: Packing | None
    boxes: Mapping[int, list[Box]]  # by server


NOTHING = Held(0, None, {})


class Assignments:
    """Numbered from 1 on."""

    def __init__(self) -> None:
        self.current = 0  # held, or on its way
        self.newest = 0  # asked for
        self.moving = False  # packets are changing hands, which nobody waits for
        self.may_move = True  # until that is refused
        self._before = NOTHING  # what was held when the newest was asked for
        self._refusals: dict[int, int] = {}  # of the newest: what each server that refused it still holds
        self._untold: list[str] = []  # why it was refused, each cause once, until somebody is told

    @property
    def refused(self) -> bool:
        """Whether somebody has refused the newest one."""
        return bool(self._refusals)

    def begin(self, before: Held | None, moving: bool = False) -> None:
        """Ask for another one. `before` is what is held; None where nothing came of the last one."""
        self._before = before or self._before
        self.newest += 1
        self.current, self.moving, self._refusals, self._untold = self.newest, moving, {}, []

    def refuse(self, server: int, held: int, error: VolsplatError) -> bool:
        """A server refuses the newest one, and still holds another. True for the first, if somebody waits for it."""
        first = not self._refusals
        self._untold += [str(error)] if str(error) not in self._untold else []
        self._refusals[server] = held
        self.may_move = self.may_move and not self.moving
        return first and not self.moving

    def take_refusal(self) -> str:
        """Why the newest was refused, once; empty if it was not."""
        causes, self._untold = self._untold, []
        return "; ".join(causes)

    def refuse_all(self, servers: Iterable[int], held: int) -> None:
        """Nobody gets anything."""
        self._refusals = dict.fromkeys(servers, held)

    def end_refused(self, boxes: Mapping[int, list[Box]]) -> Held:
        """What all servers that were to hold these boxes still hold, which is held again."""
        before = self._before
        kept = before.assignment and all(self._refusals.get(server) == before.assignment for server in boxes)
        others = any(before.boxes.get(server) != held for server, held in boxes.items())
        if others and boxes.keys() != before.boxes.keys():
            kept = False  # what a lost or new one was to hold is held by nobody else
        if not kept:
            return NOTHING
        self.current = before.assignment
        self.may_move = self.may_move and not others
        return before
