"""Messages about who did what when, for those who ask where a frame's time goes."""

from typing import Annotated

from msgspec import Meta

from volsplat.protocol.messages.message import Count, Detail, FrameId, Line, Message, asks
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT

MOST_SPANS = 1 << 13  # of one server and frame: no more than a message holds
FURTHEST_CLOCK = 1e12  # seconds, either way


class ClockRead(Message, frozen=True):
    """Map/shade server or splat server to client: what your clock shows, seconds since any moment of its own."""

    clock: Annotated[float, Meta(ge=-FURTHEST_CLOCK, le=FURTHEST_CLOCK)]


@asks(CLIENT_TO_MAPSHADE, ClockRead)
@asks(CLIENT_TO_SPLAT, ClockRead)
class ReadClock(Message, frozen=True):
    """Client to map/shade server and splat server: what does your clock show, by which your spans are told?"""


class Span(Detail, frozen=True, array_like=True):
    """What one `row` of a process, mostly a thread, was at, by the process's clock."""

    row: Line
    name: Line
    began: float
    ended: float

    def __post_init__(self) -> None:
        if not -FURTHEST_CLOCK <= self.began <= self.ended <= FURTHEST_CLOCK:
            raise ValueError(f"a span cannot last from {self.began} to {self.ended} s")


class FrameTraced(Message, frozen=True):
    """Map/shade server or splat server to client: what was done for this frame, none if it was not traced.

    Of those on one row one may lie in another, but none overlaps another by a part. `left_out` did not fit.
    """

    of_frame: FrameId
    spans: Annotated[list[Span], Meta(max_length=MOST_SPANS)]
    left_out: Count


@asks(CLIENT_TO_MAPSHADE, FrameTraced)
@asks(CLIENT_TO_SPLAT, FrameTraced)
class ReadTrace(Message, frozen=True):
    """Client to map/shade server and splat server: what did you do for this frame, which was to be `traced`?"""

    of_frame: FrameId
