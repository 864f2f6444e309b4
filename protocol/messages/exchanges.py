"""What may be said in an open connection between the client and a server, and when.

The client asks, a server answers: each request opens an exchange, and outside of one a server says no more than that it
is there, or leaves. Requests declare theirs (see message); the table in docs/how_it_works/protocol.md is drawn from
that. Both ends keep the exchanges of their connection, so that a message out of turn ends that connection (see
connection) and reaches nobody.

A server works through its requests in order (questions about the volume aside). So what it answers of one frame, or
of one assignment of sub-cubes, ends all exchanges about older ones. Traces aside: they are asked for of frames that are
over, maybe while the next one runs, and name theirs otherwise (`of_frame`).
"""

import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from volsplat.protocol.messages.frame_messages import RenderFrame
from volsplat.protocol.messages.image_messages import ImageRead
from volsplat.protocol.messages.message import MAX_SERVERS, OTHERS_AT_ONCE, Exchange, Message
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT, Way
from volsplat.protocol.messages.session_messages import Refused
from volsplat.protocol.messages.vocabulary import MESSAGES
from volsplat.protocol.text.printable import printable

RISING = ("frame", "assignment")  # ids that order what they name

EXCHANGES: dict[Way, dict[type[Message], Exchange]] = {
    way: {kind: kind.exchanges[way] for kind in MESSAGES if way in kind.exchanges}
    for way in (CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT)
}

ANSWERS: dict[Way, frozenset[type[Message]]] = {  # what is said in an exchange alone
    way: frozenset([Refused, *(answer for exchange in kinds.values() for answer in exchange.answers)])
    for way, kinds in EXCHANGES.items()
}


def superseded(older: Message | None, newer: Message) -> bool:
    """Whether a request that waits needs no answer any more, now that a newer one of its kind is here."""
    if type(older) is not type(newer):
        return False
    return any(kind.newest and _name(older, kind) != _name(newer, kind) for kind in newer.exchanges.values())


@dataclass
class _Open:
    """An exchange that is not over."""

    name: tuple[object, ...]  # values of the fields that name it
    answered: int = 0  # answers that have come


class Exchanges:
    """Those of one connection. Any thread may call it."""

    def __init__(self, asking: Way) -> None:
        """`asking` is the way that the requests go."""
        self._asking = asking
        self._kinds = EXCHANGES[asking]
        self._lock = threading.Lock()  # guards what follows
        self._open: dict[type[Message], deque[_Open]] = {kind: deque() for kind in self._kinds}  # oldest first
        self._sizes: dict[int, tuple[int, int]] = {}  # of the images that were asked for, by frame; oldest first

    def check(self, message: Message) -> None:
        """Raises ValueError for a message that is out of turn."""
        with self._lock:
            if type(message) in self._kinds:
                self._check_request(message)
            elif type(message) in ANSWERS[self._asking]:
                self._find(message)
                if isinstance(message, ImageRead):
                    self._check_size(message)

    def said(self, message: Message) -> None:
        """A message that has passed the check: move on."""
        with self._lock:
            kind = self._kinds.get(type(message))
            if kind is not None:
                waiting = self._open[type(message)]
                waiting.append(_Open(_name(message, kind)))
                if len(waiting) > kind.at_once:
                    waiting.popleft()
                if isinstance(message, RenderFrame):
                    self._note_size(message)
            elif type(message) in ANSWERS[self._asking]:
                self._answered(message)

    def _check_request(self, request: Message) -> None:
        kind, waiting = self._kinds[type(request)], self._open[type(request)]
        if kind.newest:
            name = _name(request, kind)
            too_many = sum(exchange.name == name for exchange in waiting) >= OTHERS_AT_ONCE
        else:
            too_many = len(waiting) >= kind.at_once
        if too_many:
            raise ValueError(f"{_told(request)} came while too many before it wait for an answer ({len(waiting)})")

    def _check_size(self, image: ImageRead) -> None:
        """Before there is memory for it: what was not asked for may be larger than any memory."""
        right, bottom = image.left + image.width, image.top + image.height
        width, height = self._sizes.get(image.frame, (right, bottom))
        if right > width or bottom > height:
            raise ValueError(
                f"{_told(image)} reaches to {right} x {bottom} pixels, but {width} x {height} were asked for"
            )

    def _note_size(self, request: RenderFrame) -> None:
        self._sizes[request.frame] = request.drawing.plan.image_size
        if len(self._sizes) > MAX_SERVERS:
            del self._sizes[next(iter(self._sizes))]

    def _answered(self, answer: Message) -> None:
        request, exchange = self._find(answer)
        exchange.answered += 1
        if isinstance(answer, Refused) or exchange.answered == len(self._kinds[request].answers):
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

    def _find(self, answer: Message) -> tuple[type[Message], _Open]:
        """The exchange in which this is an answer, with its request. Raises ValueError for none."""
        for request, exchange in self._answerable(answer):
            named_by = self._kinds[request].named_by
            known = [n for n, key in enumerate(named_by) if hasattr(answer, key)]  # Refused names no part
            if all(exchange.name[n] == getattr(answer, named_by[n]) for n in known):
                return request, exchange
        raise ValueError(f"{_told(answer)} came unasked")

    def _answerable(self, answer: Message) -> Iterator[tuple[type[Message], _Open]]:
        """Open exchanges in which a message of this kind may come."""
        for request, kind in self._kinds.items():
            for exchange in self._open[request]:
                if isinstance(answer, Refused):
                    if answer.request == request.__name__:
                        yield request, exchange
                elif isinstance(answer, kind.answers[exchange.answered]):
                    yield request, exchange


def _name(message: Message, kind: Exchange) -> tuple[object, ...]:
    return tuple(getattr(message, key) for key in kind.named_by)


def _told(message: Message) -> str:
    """A message for a person: its kind, and the ids that it carries."""
    ids = [f"{key}={id}" for key in ("frame", "assignment", "question") if (id := getattr(message, key, 0))]
    of = [f"request={printable(message.request)[:40]}"] if isinstance(message, Refused) else []
    return type(message).__name__ + (f" ({', '.join(of + ids)})" if of or ids else "")
