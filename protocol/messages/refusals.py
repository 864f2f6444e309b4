"""How a server answers a request that failed, or ends without its client: by one clear line, whatever went wrong."""

import logging

from volsplat.protocol.messages.messages import LONGEST_LINE, Message, Reason, Refused
from volsplat.protocol.text.errors import NoRoom, PeerLost, VolsplatError
from volsplat.protocol.text.want_of_threads import CURE, is_want_of_threads

log = logging.getLogger(__name__)

OUT_OF_MEMORY = (
    "the memory of a server does not suffice; ask for a smaller image (--size) or divide the volume among more "
    "map/shade servers (--workers)"
)


def refusal(request: Message, error: Exception) -> Refused:
    """The answer to `request`, which ended in `error`. An internal error is logged with its traceback."""
    return Refused(
        request=type(request).__name__,
        cause=_cause(error)[:LONGEST_LINE],
        reason=_reason(error),
        frame=getattr(request, "frame", 0),
        assignment=getattr(request, "assignment", 0),
        question=getattr(request, "question", 0),
    )


def why_unheard(client: object, error: Exception) -> VolsplatError:
    """Why a server hears its client no more, once receiving has ended in `error`."""
    match error:
        case VolsplatError():
            return error
        case MemoryError():
            return VolsplatError(f"the memory does not suffice for what {client} sends")
    return _internal("the client is not heard any more", error)


def why_silent(client: object, error: Exception) -> VolsplatError:
    """Why a server says nothing more to its client, once sending has ended in an `error` that is not the line's."""
    if isinstance(error, MemoryError):
        return VolsplatError(f"the memory does not suffice for what is sent to {client}")
    return _internal("nothing more can be said to the client", error)


def _internal(line: str, error: Exception) -> VolsplatError:
    log.error("%s", line, exc_info=error)
    return VolsplatError(f"{line}: {type(error).__name__}: {error}")


def _reason(error: Exception) -> Reason:
    match error:
        case PeerLost():
            return Reason.PEER_LOST
        case NoRoom():
            return Reason.NO_ROOM
    return Reason.REQUEST


def _cause(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return OUT_OF_MEMORY
    if is_want_of_threads(error):
        return CURE
    line = " ".join(str(error).split())
    if line and isinstance(error, VolsplatError | ValueError | OSError):
        return line
    log.error("internal error in volsplat", exc_info=error)
    return f"internal error in volsplat, please report it: {type(error).__name__}: {line}"
