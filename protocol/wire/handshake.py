"""The handshake: both sides prove that they know the session token without sending it. No socket inside.

The transitions are the table below; the picture in docs/how_it_works/protocol.md is drawn from it. What no table can
hold is checked before a transition: versions, roles and proofs. An event that is illegal or fails its check raises and
leaves the state as it was.

Each proof is HMAC-SHA256 with the token as key, over the prover's side, both greetings (so both nonces, roles and
version ranges), what the connection is bound to and, in Welcome, the id. Over TLS it is bound to the accepter's
certificate, as shown by one side and seen by the other: whoever stands between has to show another. The side in it
keeps a proof from being sent back to the one who made it; the dialler proves itself first, so that whoever connects to
a port learns nothing to try tokens on. Where the accepter holds each peer to a token of its own (data links), that one
is the key.
"""

import hmac
import secrets
from collections.abc import Callable
from enum import Enum

from volsplat.protocol.messages.control_part import encode_control
from volsplat.protocol.messages.greetings import NONCE_BYTES, Challenge, Hello, Proof, Rejected, Welcome
from volsplat.protocol.messages.messages import LONGEST_LINE, Message
from volsplat.protocol.messages.roles import DIALLED, Role, Way
from volsplat.protocol.messages.versions import SPOKEN, VersionRange
from volsplat.protocol.text.errors import BadInput, LocalProtocolError, RemoteProtocolError, TurnedAway
from volsplat.protocol.text.printable import printable
from volsplat.protocol.wire.tokens import Token


class Side(Enum):
    DIALLER = "dialler"
    ACCEPTER = "accepter"


class Does(Enum):
    SENDS = "sends"
    RECEIVES = "receives"


class State(Enum):
    READY = "ready"
    HELLO_SENT = "hello sent"
    CHALLENGED = "challenged"
    PROOF_SENT = "proof sent"
    WAITING = "waiting"
    GREETED = "greeted"
    CHALLENGE_SENT = "challenge sent"
    PROVEN = "proven"
    OPEN = "open"
    REJECTED = "rejected"


BEGIN = {Side.DIALLER: State.READY, Side.ACCEPTER: State.WAITING}

TRANSITIONS: dict[Side, dict[State, dict[tuple[Does, type[Message]], State]]] = {
    Side.DIALLER: {
        State.READY: {(Does.SENDS, Hello): State.HELLO_SENT},
        State.HELLO_SENT: {
            (Does.RECEIVES, Challenge): State.CHALLENGED,
            (Does.RECEIVES, Rejected): State.REJECTED,
        },
        State.CHALLENGED: {
            (Does.SENDS, Proof): State.PROOF_SENT,
            (Does.SENDS, Rejected): State.REJECTED,
        },
        State.PROOF_SENT: {
            (Does.RECEIVES, Welcome): State.OPEN,
            (Does.RECEIVES, Rejected): State.REJECTED,
        },
        State.OPEN: {},
        State.REJECTED: {},
    },
    Side.ACCEPTER: {
        State.WAITING: {
            (Does.RECEIVES, Hello): State.GREETED,
            (Does.RECEIVES, Rejected): State.REJECTED,
        },
        State.GREETED: {
            (Does.SENDS, Challenge): State.CHALLENGE_SENT,
            (Does.SENDS, Rejected): State.REJECTED,
        },
        State.CHALLENGE_SENT: {
            (Does.RECEIVES, Proof): State.PROVEN,
            (Does.RECEIVES, Rejected): State.REJECTED,
            (Does.SENDS, Rejected): State.REJECTED,
        },
        State.PROVEN: {
            (Does.SENDS, Welcome): State.OPEN,
            (Does.SENDS, Rejected): State.REJECTED,
        },
        State.OPEN: {},
        State.REJECTED: {},
    },
}


class Handshake:
    """One side's state, moved by the table."""

    def __init__(self, side: Side, token: Token) -> None:
        self.side = side
        self.state = BEGIN[side]
        self._token = token
        self.binding = b""  # what both proofs are bound to besides (see Connection.binding)

    def _next(self, does: Does, kind: type[Message]) -> State:
        try:
            return TRANSITIONS[self.side][self.state][does, kind]
        except KeyError:
            line = f"{kind.__name__} is out of place: the {self.side.value} is in state {self.state.value!r}"
            raise (LocalProtocolError if does is Does.SENDS else RemoteProtocolError)(line) from None

    def _proof(self, prover: Side, hello: Hello, challenge: Challenge, server: int) -> bytes:
        proof = hmac.new(self._token.key, digestmod="sha256")
        greetings = encode_control(hello), encode_control(challenge)
        for part in (b"volsplat", prover.value.encode(), *greetings, self.binding):
            proof.update(len(part).to_bytes(8, "little") + part)
        proof.update(server.to_bytes(8, "little"))
        return proof.digest()


class DiallerHandshake(Handshake):
    """The side that dials: call start(), then receive() with each message until the state is OPEN."""

    def __init__(self, token: Token, hello: Hello, expected: Role, engaged: Callable[[], str] = lambda: "") -> None:
        """`expected` is the role that the accepter must have; make `hello` with new_hello().

        `engaged` says why this side cannot take part now, if so: then it rejects the accepter.
        """
        super().__init__(Side.DIALLER, token)
        self._engaged = engaged
        self.rejection = ""  # why this side rejected, in our words
        self.hello = hello
        self.expected = expected
        self.challenge: Challenge | None = None
        self.version = 0  # agreed on, from CHALLENGED on
        self.id = 0  # our id in the session, from OPEN on

    def start(self) -> Hello:
        self.state = self._next(Does.SENDS, Hello)
        return self.hello

    def receive(self, message: Message) -> Proof | Rejected | None:
        """The message to send next, if any.

        Raises BadInput for what a person can cure (another version, token or kind of server, a rejection), TurnedAway
        for a rejection that may pass, or RemoteProtocolError.
        """
        state = self._next(Does.RECEIVES, type(message))
        match message:
            case Challenge():
                return self._challenged(message)
            case Welcome():
                self._check_welcome(message)
                self.id = message.id
                self.state = state
            case Rejected():
                self.state = state
                told = f"it rejected this side: {printable(message.cause)}"
                raise (TurnedAway if message.passing else BadInput)(told)
        return None

    def _challenged(self, challenge: Challenge) -> Proof | Rejected:
        if challenge.role != self.expected:
            raise BadInput(f"it is a {challenge.role}, not a {self.expected}; check host and port")
        version = self.hello.versions.shared(challenge.versions)
        if version is None:
            raise BadInput(
                no_shared_version(
                    f"this {self.hello.role}", self.hello.versions, f"the {challenge.role}", challenge.versions
                )
            )
        if hmac.compare_digest(challenge.nonce, self.hello.nonce):
            raise RemoteProtocolError("Challenge.nonce is our own, but each side must draw its own")
        self.state = self._next(Does.RECEIVES, Challenge)
        self.challenge, self.version = challenge, version
        if cause := self._engaged():
            self.state, self.rejection = self._next(Does.SENDS, Rejected), cause
            return Rejected(cause[:LONGEST_LINE])
        self.state = self._next(Does.SENDS, Proof)
        return Proof(self._proof(Side.DIALLER, self.hello, challenge, 0))

    def _check_welcome(self, welcome: Welcome) -> None:
        assert self.challenge is not None
        right = self._proof(Side.ACCEPTER, self.hello, self.challenge, welcome.id)
        if not hmac.compare_digest(welcome.proof, right):
            raise BadInput("it does not know the session token; something else may be listening there")


class AccepterHandshake(Handshake):
    """The side that accepts: call receive() with each message; in state PROVEN, call welcome() or reject()."""

    def __init__(
        self,
        token: Token,
        role: Role,
        versions: VersionRange = SPOKEN,
        token_of: Callable[[Hello], Token] | None = None,
    ) -> None:
        """`token_of` gives the token that this peer must know instead; it may raise TooEarly."""
        super().__init__(Side.ACCEPTER, token)
        self._token_of = token_of
        self.challenge = Challenge(role, versions.oldest, versions.newest, secrets.token_bytes(NONCE_BYTES))
        self.hello: Hello | None = None
        self.version = 0  # agreed on, from CHALLENGE_SENT on
        self.rejection = ""  # why the peer was rejected, in our words

    def receive(self, message: Message) -> Challenge | Rejected | None:
        """The message to send next, if any; after Rejected, `rejection` says why.

        Raises RemoteProtocolError, TooEarly where the peer's own token is not known yet, or TurnedAway where it rejects
        this side, which may be otherwise later.
        """
        state = self._next(Does.RECEIVES, type(message))
        match message:
            case Rejected():
                self.state = state
                raise TurnedAway(printable(message.cause))
            case Hello():
                self.state, self.hello = state, message
                return self._greeted(message)
            case Proof():
                assert self.hello is not None
                if self._token_of is not None:
                    self._token = self._token_of(self.hello)
                if not hmac.compare_digest(message.proof, self._proof(Side.DIALLER, self.hello, self.challenge, 0)):
                    return self.reject(self._unproven(self.hello))
                self.state = state
        return None

    def welcome(self, server: int) -> Welcome:
        """Let the peer in under the id `server`."""
        state = self._next(Does.SENDS, Welcome)
        assert self.hello is not None
        self.state = state
        return Welcome(server, self._proof(Side.ACCEPTER, self.hello, self.challenge, server))

    def reject(self, cause: str) -> Rejected:
        """Turn the peer away, for a cause that both sides will show."""
        self.state = self._next(Does.SENDS, Rejected)
        self.rejection = cause
        return Rejected(cause[:LONGEST_LINE])

    def _unproven(self, hello: Hello) -> str:
        if self._token_of is not None:
            return f"the {hello.role} does not know the key that the client gave to worker {hello.server} alone"
        return (
            f"the {hello.role} has another session token than the {self.challenge.role}; start it with the token of "
            "this session (VOLSPLAT_TOKEN or --token-file)"
        )

    def _greeted(self, hello: Hello) -> Challenge | Rejected:
        if Way(hello.role, self.challenge.role) not in DIALLED:
            return self.reject(
                f"it is a {hello.role}, which does not dial a {self.challenge.role}; check host and port"
            )
        version = self.challenge.versions.shared(hello.versions)
        if version is None:
            return self.reject(
                no_shared_version(
                    f"the {hello.role}", hello.versions, f"the {self.challenge.role}", self.challenge.versions
                )
            )
        self.version = version
        self.state = self._next(Does.SENDS, Challenge)
        return self.challenge


def new_hello(
    role: Role,
    *,
    server: int = 0,
    data_host: str = "",
    data_port: int = 0,
    name: str = "",
    versions: VersionRange = SPOKEN,
) -> Hello:
    """A hello with a fresh nonce."""
    nonce = secrets.token_bytes(NONCE_BYTES)
    return Hello(role, versions.oldest, versions.newest, nonce, server, data_host, data_port, name[:255])


def no_shared_version(one: str, ones: VersionRange, other: str, others: VersionRange) -> str:
    return (
        f"{one} speaks protocol {ones}, {other} {others}: they share none; install the same release of volsplat on both"
    )
