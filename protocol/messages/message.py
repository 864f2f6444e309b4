"""What every message is: immutable, strictly checked, and declared in one place, on its type.

The docstring says who sends it to whom; `says` and `asks` declare the same for the program, with the answers of a
request, and `largest_payload` with `payload_bytes` what follows it. Everything else is derived.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, TypeVar

import msgspec
from msgspec import Meta

from volsplat.protocol.messages.roles import Way

LARGEST_ID = 2**31 - 1
LARGEST_COUNT = 2**62
MOST_LEVELS = 32
MAX_SERVERS = 4096
MOST_THREADS = 1024
MOST_BLOCKS = 64  # of one shared memory
OTHERS_AT_ONCE = 64
LONGEST_LINE = 1000  # characters

ServerId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # given by the client at Welcome, never used again
FrameId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # rises with each image request of a session
QuestionId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # rises with each question about the volume of a session
AssignmentId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # one partition of the volume among the workers
ReadingId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # rises with each ReadAhead of a session
IdOrNone = Annotated[int, Meta(ge=0, le=LARGEST_ID)]  # 0: none
LevelNumber = Annotated[int, Meta(ge=0, lt=MOST_LEVELS)]
Count = Annotated[int, Meta(ge=0, le=LARGEST_COUNT)]
Ordinal = Annotated[int, Meta(ge=0, le=2**32 - 1)]  # as in a row run
Seconds = Annotated[float, Meta(ge=0)]
BlockNumber = Annotated[int, Meta(ge=0, lt=MOST_BLOCKS)]
BlockCount = Annotated[int, Meta(ge=1, le=MOST_BLOCKS)]
Threads = Annotated[int, Meta(ge=1, le=MOST_THREADS)]  # of one server
Line = Annotated[str, Meta(max_length=LONGEST_LINE)]
ServerIds = Annotated[list[ServerId], Meta(max_length=MAX_SERVERS)]


class Message(msgspec.Struct, frozen=True, tag=True, tag_field="message", forbid_unknown_fields=True):
    """Base of all messages: immutable, told apart by their name, strict about unknown fields."""

    ways: ClassVar[tuple[Way, ...]] = ()  # which it may go, once the handshake is over
    exchanges: ClassVar[Mapping[Way, "Exchange"]] = {}  # that it opens, as a request
    ends: ClassVar[bool] = False  # nothing may follow it this way
    of_connection: ClassVar[bool] = False  # a connection says and takes it by itself
    largest_payload: ClassVar[int] = 0  # bytes

    @property
    def brings_memory(self) -> bool:
        """Whether the descriptor of shared memory comes with it (see shared_memory)."""
        return False

    def payload_bytes(self) -> int:
        """How many bytes follow it. Raises ValueError if it announces what cannot be."""
        return 0


class Detail(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of what messages are made of."""


@dataclass(frozen=True)
class Exchange:
    """What a server owes for a request: these answers, one after the other. Refused ends any exchange."""

    answers: tuple[type[Message], ...]
    named_by: tuple[str, ...]  # the fields that tell exchanges of this kind apart: those that request and answers share
    at_once: int  # so many may wait for an answer …
    newest: bool  # … or else the oldest is forgotten: one with a newer name takes the place of older ones


Kind = TypeVar("Kind", bound=type[Message])


def says(*ways: Way, ends: bool = False, of_connection: bool = False) -> Callable[[Kind], Kind]:
    """A message that nothing asks for and nothing answers."""

    def declare(kind: Kind) -> Kind:
        kind.ways, kind.ends, kind.of_connection = ways, ends, of_connection
        return kind

    return declare


def asks(
    way: Way, *answers: type[Message], at_once: int = OTHERS_AT_ONCE, newest: bool = False
) -> Callable[[Kind], Kind]:
    """A request that goes this way; its answers come back."""

    def declare(kind: Kind) -> Kind:
        shared = set.intersection(*(set(answer.__struct_fields__) for answer in answers))
        named_by = tuple(field for field in kind.__struct_fields__ if field in shared)
        kind.exchanges = {way: Exchange(answers, named_by, at_once, newest), **kind.exchanges}
        kind.ways = (way, *kind.ways)
        for answer in answers:
            answer.ways = tuple(dict.fromkeys((way.back, *answer.ways)))
        return kind

    return declare
