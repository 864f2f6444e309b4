"""In which order those draw who share a session: a hand at work first, whoever only refines a picture when it is free.

Viewers of a session, as viewports are, draw in turns, and may lose one. What a script asks for outright has no turn: it
takes the place of what runs, unless that is what a hand moves, or a viewer's that lost its turn before.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Urgency(IntEnum):
    """Of a turn; the lowest goes first."""

    MOVING = 0  # one picture of a scene that a hand moves
    CHANGED = 1  # a scene that was not drawn yet
    OWED = 2  # a scene whose turn was lost to somebody else: scripts wait for it, so that it is drawn at all
    AT_REST = 3  # what can wait until nobody else draws


KEPT_FROM_SCRIPTS = (Urgency.MOVING, Urgency.OWED)


@dataclass(eq=False)
class Turn:
    """One viewer's. Guarded by who holds the Turns."""

    urgency: Urgency = Urgency.AT_REST
    over: bool = False  # its viewer wants nothing more
    frame: int | None = None  # the newest that was asked for in it


class Turns:
    """Who has the session, who waits for it, and which frames have no turn. For one thread at a time."""

    def __init__(self) -> None:
        self.holder: Turn | None = None
        self.outright: set[int] = set()  # frames of scripts that are not finished
        self._waiting: list[Turn] = []  # first come, first served

    def wait(self, turn: Turn, urgency: Urgency) -> None:
        turn.urgency = urgency
        self._waiting.append(turn)

    def may_begin(self, turn: Turn) -> bool:
        """Whether one that waits may have the session, whoever has it now."""
        urgency, holder = turn.urgency, self.holder
        if turn is not min(self._waiting, key=lambda waiting: waiting.urgency):
            return False
        if self.outright and urgency is not Urgency.MOVING:
            return False
        newer = urgency is Urgency.CHANGED  # of two scenes the one that was changed last
        return holder is None or urgency < holder.urgency or (newer and urgency == holder.urgency)

    def begin(self, turn: Turn) -> None:
        self._waiting.remove(turn)
        self.holder = turn

    def leave(self, turn: Turn) -> None:
        """It neither waits nor has the session any more."""
        if turn in self._waiting:
            self._waiting.remove(turn)
        if self.holder is turn:
            self.holder = None

    @property
    def scripts_wait(self) -> bool:
        """Whether what a script asks for must wait for somebody's turn."""
        if self.holder is not None:
            return self.holder.urgency in KEPT_FROM_SCRIPTS
        return not self.outright and any(waiting.urgency in KEPT_FROM_SCRIPTS for waiting in self._waiting)
