"""What may be said in an open connection between the client and a server, and when.

The client asks, a server answers: each request opens an exchange, and a server says nothing outside of one. The table
below holds every exchange; the one in docs/protocol.md is drawn from it. Both ends keep the exchanges of their
connection, so that a message out of turn ends that connection (see connection) and reaches nobody.

A server works through its requests in order (probes aside). So what it answers of one frame, or of one assignment of
sub-cubes, ends all exchanges about older ones.
"""

import threading
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

from volsplat.protocol.messages import messages
from volsplat.protocol.messages.messages import MAX_SERVERS, Message
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT, Way
from volsplat.protocol.text.printable import printable

RISING = ("frame", "assignment")  # ids that order what they name
PROBES_AT_ONCE = 1024
PARTS_AT_ONCE = 4  # each brings its values along
OTHERS_AT_ONCE = 64


class State(Enum):
    ASKED = "asked"
    FINISHED = "finished"  # the frame is; its image follows
    OVER = "over"


Answers = Mapping[State, Mapping[type[Message], State]]  # which may come in a state, and where they lead


@dataclass(frozen=True)
class Exchange:
    """A kind of request, and what may be answered to it. Refused ends any."""

    named_by: tuple[str, ...]  # the fields that tell exchanges of this kind apart, in the request and its answers
    answers: Answers
    at_once: int = OTHERS_AT_ONCE  # so many may wait for an answer …
    newest: bool = False  # … or else the oldest is forgotten: one with a newer name takes the place of older ones


def _answered_by(answer: type[Message]) -> Answers:
    return {State.ASKED: {answer: State.OVER}}


EXCHANGES: dict[Way, dict[type[Message], Exchange]] = {
    CLIENT_TO_MAPSHADE: {
        messages.DescribeVolume: Exchange((), _answered_by(messages.VolumeDescribed)),
        messages.ReadSubCubes: Exchange(("assignment",), _answered_by(messages.SubCubesRead)),
        messages.LendVolume: Exchange(("assignment",), _answered_by(messages.VolumeLent)),
        messages.ReadPart: Exchange(("assignment", "part"), _answered_by(messages.PartRead), at_once=MAX_SERVERS),
        messages.AwaitParts: Exchange(("assignment",), _answered_by(messages.SubCubesRead)),
        messages.HoldPart: Exchange(("assignment",), _answered_by(messages.PartHeld), at_once=PARTS_AT_ONCE),
        messages.CountHistograms: Exchange(("assignment",), _answered_by(messages.HistogramsCounted)),
        messages.PackVoxels: Exchange(("assignment",), _answered_by(messages.VoxelsPacked)),
        messages.DescribeMachine: Exchange((), _answered_by(messages.MachineDescribed)),
        messages.OpenPackets: Exchange(
            ("assignment",), _answered_by(messages.VoxelsPacked), at_once=MAX_SERVERS, newest=True
        ),
        messages.ConnectToSplatServers: Exchange((), _answered_by(messages.ConnectedToSplatServers)),
        messages.RenderFrame: Exchange(
            ("frame",), _answered_by(messages.FrameMapped), at_once=MAX_SERVERS, newest=True
        ),
        messages.AbortFrame: Exchange(("frame",), _answered_by(messages.FrameAborted), at_once=MAX_SERVERS),
        messages.ProbeVoxels: Exchange(("probe",), _answered_by(messages.VoxelProbed), at_once=PROBES_AT_ONCE),
    },
    CLIENT_TO_SPLAT: {
        messages.ReadImage: Exchange(("frame",), _answered_by(messages.ImageRead), at_once=MAX_SERVERS, newest=True),
        messages.RenderFrame: Exchange(
            ("frame",),
            {
                State.ASKED: {messages.FrameFinished: State.FINISHED},
                State.FINISHED: {messages.ImageRead: State.OVER},
            },
            at_once=MAX_SERVERS,
            newest=True,
        ),
        messages.AbortFrame: Exchange(("frame",), _answered_by(messages.FrameAborted), at_once=MAX_SERVERS),
    },
}


def superseded(older: Message | None, newer: Message) -> bool:
    """Whether a request that waits needs no answer any more, now that a newer one of its kind is here."""
    kind = type(newer)
    exchange = next((kinds[kind] for kinds in EXCHANGES.values() if kind in kinds and kinds[kind].newest), None)
    return (
        exchange is not None
        and type(older) is kind
        and _name(older, exchange.named_by) != _name(newer, exchange.named_by)
    )


UNANSWERED = (messages.InviteWorkers, messages.EndSession)


@dataclass
class _Open:
    """An exchange that is not over."""

    name: tuple[object, ...]  # values of the fields that name it
    state: State = State.ASKED


class Exchanges:
    """Those of one connection. Any thread may call it."""

    def __init__(self, asking: Way) -> None:
        """`asking` is the way that the requests go."""
        self._kinds = EXCHANGES[asking]
        self._lock = threading.Lock()  # guards what follows
        self._open: dict[type[Message], deque[_Open]] = {kind: deque() for kind in self._kinds}  # oldest first
        self._sizes: dict[int, tuple[int, int]] = {}  # of the images that were asked for, by frame; oldest first

    def check(self, message: Message) -> None:
        """Raises ValueError for a message that is out of turn."""
        with self._lock:
            if type(message) in self._kinds:
                self._check_request(message)
            elif not isinstance(message, UNANSWERED):
                self._find(message)
                if isinstance(message, messages.ImageRead):
                    self._check_size(message)

    def said(self, message: Message) -> None:
        """A message that has passed the check: move on."""
        with self._lock:
            kind = self._kinds.get(type(message))
            if kind is not None:
                waiting = self._open[type(message)]
                waiting.append(_Open(_name(message, kind.named_by)))
                if len(waiting) > kind.at_once:
                    waiting.popleft()
                if isinstance(message, messages.RenderFrame):
                    self._note_size(message)
            elif not isinstance(message, UNANSWERED):
                self._answered(message)

    def _check_request(self, request: Message) -> None:
        kind, waiting = self._kinds[type(request)], self._open[type(request)]
        if kind.newest:
            name = _name(request, kind.named_by)
            too_many = sum(exchange.name == name for exchange in waiting) >= OTHERS_AT_ONCE
        else:
            too_many = len(waiting) >= kind.at_once
        if too_many:
            raise ValueError(f"{_told(request)} came while too many before it wait for an answer ({len(waiting)})")

    def _check_size(self, image: messages.ImageRead) -> None:
        """Before there is memory for it: what was not asked for may be larger than any memory."""
        width, height = self._sizes.get(image.frame, (image.width, image.height))
        if (image.width, image.height) != (width, height):
            raise ValueError(
                f"{_told(image)} has {image.width} x {image.height} pixels, but {width} x {height} were asked for"
            )

    def _note_size(self, request: messages.RenderFrame) -> None:
        self._sizes[request.frame] = (request.scene.image.width, request.scene.image.height)
        if len(self._sizes) > MAX_SERVERS:
            del self._sizes[next(iter(self._sizes))]

    def _answered(self, answer: Message) -> None:
        request, exchange, state = self._find(answer)
        exchange.state = state
        if state is State.OVER:
            self._open[request].remove(exchange)
        for key in RISING:
            if newest := getattr(answer, key, 0):
                self._forget_older(key, newest)

    def _forget_older(self, key: str, newest: int) -> None:
        for request, kind in self._kinds.items():
            if kind.named_by[:1] == (key,):
                waiting = self._open[request]
                while waiting and waiting[0].name[0] < newest:  # type: ignore[operator]  # it is an id
                    waiting.popleft()
        if key == "frame":
            self._sizes = {frame: size for frame, size in self._sizes.items() if frame >= newest}

    def _find(self, answer: Message) -> tuple[type[Message], _Open, State]:
        """The exchange in which this is an answer, and the state that it leads to. Raises ValueError for none."""
        for request, exchange, state in self._answerable(answer):
            named_by = self._kinds[request].named_by
            known = [n for n, key in enumerate(named_by) if hasattr(answer, key)]  # Refused names no part
            if all(exchange.name[n] == getattr(answer, named_by[n]) for n in known):
                return request, exchange, state
        raise ValueError(f"{_told(answer)} came unasked")

    def _answerable(self, answer: Message) -> Iterator[tuple[type[Message], _Open, State]]:
        """Open exchanges in which a message of this kind may come."""
        for request, kind in self._kinds.items():
            for exchange in self._open[request]:
                if isinstance(answer, messages.Refused):
                    if answer.request == request.__name__:
                        yield request, exchange, State.OVER
                elif (state := kind.answers[exchange.state].get(type(answer))) is not None:
                    yield request, exchange, state


def _name(message: Message, named_by: tuple[str, ...]) -> tuple[object, ...]:
    return tuple(getattr(message, key) for key in named_by)


def _told(message: Message) -> str:
    """A message for a person: its kind, and the ids that it carries."""
    ids = [f"{key}={id}" for key in ("frame", "assignment", "probe") if (id := getattr(message, key, 0))]
    of = [f"request={printable(message.request)[:40]}"] if isinstance(message, messages.Refused) else []
    return type(message).__name__ + (f" ({', '.join(of + ids)})" if of or ids else "")
