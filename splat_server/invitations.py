"""Whose data links are taken: those of the workers that the client has invited, each by a key of its own."""

from collections.abc import Mapping

from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.text.errors import TooEarly
from volsplat.protocol.wire.tokens import Token


class Invitations:
    """The newest invitation. Any thread may ask; one replaces it."""

    def __init__(self, token: Token) -> None:
        """`token` is the session's."""
        self._token = token
        self._tokens: dict[int, Token] = {}  # by worker; replaced whole, for other threads

    def replace(self, keys: Mapping[int, bytes]) -> None:
        """From now on these workers are invited and no other."""
        self._tokens = {worker: self._token.bound_to(key) for worker, key in keys.items()}

    def __contains__(self, worker: int) -> bool:
        return worker in self._tokens

    def token_of(self, hello: Hello) -> Token:
        """What a data link must prove that it knows. Raises TooEarly where its worker is not invited."""
        try:
            return self._tokens[hello.server]
        except KeyError:
            raise TooEarly(f"worker {hello.server} is not invited yet") from None
