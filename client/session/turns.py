"""In which order those draw who share a session: a hand at work first, whoever only refines a picture when it is free.

Viewers of a session, as viewports are, draw in turns, and may lose one. What a script asks for outright has no turn: it
takes the place of what runs, unless that is what a hand moves, or a viewer's that lost its turn before.

Who gave way for PATIENCE_SECONDS, script or viewer, has one picture finished before a hand has its next.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum

PATIENCE_SECONDS = 1.0  # that one gives way to others, over and over


class Urgency(IntEnum):
    """Of a turn; the lowest goes first."""

    OVERDUE = 0  # one picture of a scene that gave way for too long
    MOVING = 1  # one picture of a scene that a hand moves
    CHANGED = 2  # a scene that was not drawn yet
    OWED = 3  # a scene whose turn was lost to somebody else: scripts wait for it, so that it is drawn at all
    AT_REST = 4  # what can wait until nobody else draws


ONE_PICTURE = (Urgency.OVERDUE, Urgency.MOVING)  # for which everybody waits
KEPT_FROM_SCRIPTS = (*ONE_PICTURE, Urgency.OWED)


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
        self.overdue: set[int] = set()  # of these, those that gave way for too long
        self._overdue_scripts = 0  # that wait until they may ask
        self._waiting: list[Turn] = []  # first come, first served

    def wait(self, turn: Turn, urgency: Urgency) -> None:
        turn.urgency = urgency
        self._waiting.append(turn)

    def may_begin(self, turn: Turn) -> bool:
        """Whether one that waits may have the session, whoever has it now."""
        urgency, holder = turn.urgency, self.holder
        if turn is not min(self._waiting, key=lambda waiting: waiting.urgency):
            return False
        if urgency is Urgency.MOVING and (self.overdue or self._overdue_scripts):
            return False
        if self.outright and urgency is not Urgency.MOVING:
            return False
        if holder is not None and holder.urgency in ONE_PICTURE:
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

    def ask_outright(self, frame: int, overdue: bool) -> None:
        """It takes the place of what runs."""
        self.outright.add(frame)
        if overdue:
            self.overdue.add(frame)
        self.holder = None

    def end(self, frame: int) -> None:
        """It is drawn, or never will be."""
        self.outright.discard(frame)
        self.overdue.discard(frame)

    def finish(self, frame: int) -> None:
        """It is drawn: an overdue turn gives way again."""
        if self.holder is not None and self.holder.frame == frame and self.holder.urgency is Urgency.OVERDUE:
            self.holder.urgency = Urgency.OWED

    @property
    def scripts_wait(self) -> bool:
        """Whether what a script asks for must wait for somebody's turn."""
        if self.holder is not None:
            return self.holder.urgency in KEPT_FROM_SCRIPTS
        waiting = {turn.urgency for turn in self._waiting}
        return Urgency.OVERDUE in waiting or (not self.outright and not waiting.isdisjoint(KEPT_FROM_SCRIPTS))

    @property
    def overdue_scripts_wait(self) -> bool:
        """As `scripts_wait`, for what gave way for too long."""
        return self.holder is not None and self.holder.urgency in ONE_PICTURE

    @contextmanager
    def script_overdue(self) -> Iterator[None]:
        """Meanwhile a script that gave way for too long waits until it may ask."""
        self._overdue_scripts += 1
        try:
            yield
        finally:
            self._overdue_scripts -= 1
