"""The errors that a person sees: each is one line that names the cause and the cure."""

import traceback
from itertools import takewhile
from types import FrameType


class VolsplatError(Exception):
    """Base of all errors that are shown as one line, without a traceback."""

    def _render_traceback_(self) -> list[str]:
        """What notebooks and IPython, which look for this name, show: where the caller stood, and the line."""
        frames = takewhile(lambda place: not _is_of(place[0], __package__), traceback.walk_tb(self.__traceback__))
        callers = traceback.StackSummary.extract(place for place in frames if not _is_of(place[0], "IPython"))
        return ["".join(callers.format()) + f"{type(self).__name__}: {self}"]


def _is_of(frame: FrameType, package: str) -> bool:
    top, _, _ = str(frame.f_globals.get("__name__")).partition(".")
    return top == package.partition(".")[0]


class BadInput(VolsplatError):
    """Something that a person gave cannot be used: a file, an option, a scene."""


class NoRoom(BadInput):
    """What was asked for does not fit into the memory here; elsewhere it may."""


class LocalProtocolError(VolsplatError):
    """We were about to break the protocol: an internal error."""


class RemoteProtocolError(VolsplatError):
    """The peer broke the protocol; the connection must be closed."""


class TooEarly(VolsplatError):
    """A peer came before it was told of; the connection is closed without a word, and it dials again."""


class PeerLost(VolsplatError):
    """A server that a frame needs is gone."""


class TurnedAway(PeerLost):
    """A server that was dialled rejects this client: it serves another, is not ready yet, or alone speaks TLS."""
