"""The messages of the handshake: all that a peer can say before it has proved that it knows the session token.

They are frozen for ever: any two versions must understand each other's, or they could not state their versions.
"""

from typing import Annotated

from msgspec import Meta

from volsplat.protocol.messages.message import IdOrNone, Line, Message, ServerId
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.versions import VersionRange

NONCE_BYTES = 32
PROOF_BYTES = 32  # HMAC-SHA256

Nonce = Annotated[bytes, Meta(min_length=NONCE_BYTES, max_length=NONCE_BYTES)]
ProofBytes = Annotated[bytes, Meta(min_length=PROOF_BYTES, max_length=PROOF_BYTES)]
Version = Annotated[int, Meta(ge=1, le=65535)]


class Greeting(Message, frozen=True):
    """Base of the handshake's messages."""


class Introduction(Greeting, frozen=True):
    """Base of what each side says of itself first."""

    role: Role
    oldest: Version
    newest: Version
    nonce: Nonce

    def __post_init__(self) -> None:
        if self.oldest > self.newest:
            raise ValueError(f"oldest must not be above newest, but they are {self.oldest} and {self.newest}")

    @property
    def versions(self) -> VersionRange:
        return VersionRange(self.oldest, self.newest)


class Hello(Introduction, frozen=True):
    """Dialler to accepter: who I am and which versions I speak.

    `server` is the id that the client gave (data links), or 0. A splat server tells where it takes data links;
    an empty `data_host` means the address that it dials from. `name` is for messages to people.
    """

    server: IdOrNone = 0
    data_host: Annotated[str, Meta(max_length=255)] = ""
    data_port: Annotated[int, Meta(ge=0, le=65535)] = 0
    name: Annotated[str, Meta(max_length=255)] = ""


class Challenge(Introduction, frozen=True):
    """Accepter to dialler: who I am, which versions I speak, and the nonce to prove yourself with."""


class Proof(Greeting, frozen=True):
    """Dialler to accepter: that I know the token."""

    proof: ProofBytes


class Welcome(Greeting, frozen=True):
    """Accepter to dialler: that I know the token, too, and your id in this session."""

    id: ServerId
    proof: ProofBytes


class Rejected(Greeting, frozen=True, omit_defaults=True):
    """Either way: no, for the cause given in one line. The connection is closed after it.

    A dialler says it once it knows whom it has reached: a server that waits for clients may serve another one. An
    accepter says whether the cause is `passing`, as want of a thread is: then the dialler may try again.
    """

    cause: Line
    passing: bool = False


GREETINGS = (Hello, Challenge, Proof, Welcome, Rejected)
