"""The errors that a person sees: each is one line that names the cause and the cure."""

from volsplat.protocol.text.callers_lines import under_callers_lines


class VolsplatError(Exception):
    """Base of all errors that are shown as one line, without a traceback."""


class BadInput(VolsplatError):
    """Something that a person gave cannot be used: a file, an option, a scene."""

    _render_traceback_ = under_callers_lines


class NoRoom(BadInput):
    """What was asked for does not fit into the memory here; elsewhere it may."""


class LocalProtocolError(VolsplatError):
    """We were about to break the protocol: an internal error."""


class RemoteProtocolError(VolsplatError):
    """The peer broke the protocol; the connection must be closed."""


class TooEarly(VolsplatError):
    """A peer came before it was told of, or too late; the connection is closed without a word, and it dials again."""


class NoThread(VolsplatError, RuntimeError):
    """The system gives this process no further thread: the RuntimeError that Python raises for it, with the cure."""


class PeerLost(VolsplatError):
    """A server that a frame needs is gone."""

    _render_traceback_ = under_callers_lines


class NobodyListens(PeerLost):
    """No program waits at the address that was dialled: it may not have been started yet."""


class TurnedAway(PeerLost):
    """Who was dialled rejects this side: it serves another, is not ready yet, alone speaks TLS, or has no thread."""
