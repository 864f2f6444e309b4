"""The session token: a secret that every server of a session knows and that never crosses a connection.

It comes from the environment or from a file that only its owner can read; a command line can be read by everybody.
"""

import hmac
import os
import secrets
import stat
import sys
from collections.abc import Mapping
from pathlib import Path

from volsplat.protocol.text.errors import BadInput

TOKEN_VARIABLE = "VOLSPLAT_TOKEN"
SHORTEST_TOKEN = 32  # characters: one that can be guessed protects nothing
LONGEST_TOKEN = 1024
STDIN = Path("-")  # as a token file


class Token:
    """A session token. Neither str() nor repr() shows it, so that no log does."""

    def __init__(self, text: str) -> None:
        """Raises ValueError for a text that is too short, too long or not printable ASCII."""
        if not SHORTEST_TOKEN <= len(text) <= LONGEST_TOKEN:
            raise ValueError(f"a token has {SHORTEST_TOKEN} to {LONGEST_TOKEN} characters, not {len(text)}")
        if not (text.isascii() and text.isprintable() and " " not in text):
            raise ValueError("a token is printable ASCII without spaces")
        self._text = text

    def __repr__(self) -> str:
        return "Token(hidden)"

    @property
    def key(self) -> bytes:
        """What proofs are made with."""
        return self._text.encode("ascii")

    def bound_to(self, worker_key: bytes) -> "Token":
        """What proves a worker's data link: it takes both this token and the key that the client gave the worker."""
        return Token(hmac.new(self.key, b"volsplat data link" + worker_key, "sha256").hexdigest())

    def added_to(self, environment: Mapping[str, str]) -> dict[str, str]:
        """A copy of `environment` for a server that this process starts on its own machine."""
        return {**environment, TOKEN_VARIABLE: self._text}

    def write(self, path: Path) -> None:
        """Make a file that only its owner can read. Raises BadInput where `path` exists or cannot be written."""
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except OSError as error:
            raise BadInput(f"the token file {path} cannot be made: {error.strerror}; name another") from error
        try:
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                file.write(self._text + "\n")
        except OSError as error:
            path.unlink()
            raise BadInput(f"the token file {path} cannot be written: {error.strerror}; make room there") from error


def new_token() -> Token:
    """A token of 256 random bits."""
    return Token(secrets.token_urlsafe(32))


def find_token(environment: Mapping[str, str], token_file: Path | None = None) -> Token | None:
    """The token in `token_file` if there is one (- is standard input), else in VOLSPLAT_TOKEN; None without either.

    Raises BadInput where the file cannot be read, or can be by others, or the token is malformed.
    """
    if token_file == STDIN:
        text, place = sys.stdin.readline(LONGEST_TOKEN + 2), "standard input"
    elif token_file is not None:
        text, place = _read_private(token_file), f"the token file {token_file}"
    elif environment.get(TOKEN_VARIABLE):
        text, place = environment[TOKEN_VARIABLE], TOKEN_VARIABLE
    else:
        return None
    try:
        return Token(text.strip())
    except ValueError as error:
        raise BadInput(f"{place} holds no session token: {error}; copy it whole from the client") from error


def need_token(environment: Mapping[str, str], token_file: Path | None = None) -> Token:
    """As find_token, but raises BadInput where there is none."""
    token = find_token(environment, token_file)
    if token is None:
        raise BadInput(f"there is no session token; set {TOKEN_VARIABLE} or give --token-file: the client has it")
    return token


def _read_private(path: Path) -> str:
    try:
        # Not blocking: a FIFO without a writer would hang the open.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(descriptor, "rb") as file:
            found = os.fstat(file.fileno())  # of what was opened, not of what the name may point to by now
            if not stat.S_ISREG(found.st_mode):
                raise BadInput(f"the token file {path} is not a regular file; give one that holds the token")
            if found.st_uid not in (os.geteuid(), 0):
                raise BadInput(f"the token file {path} belongs to another user; make one of your own")
            if found.st_mode & 0o077:
                raise BadInput(f"the token file {path} can be read by others; run: chmod 600 {path}")
            return file.read(LONGEST_TOKEN + 2).decode("ascii", errors="replace")
    except OSError as error:
        raise BadInput(f"the token file {path} cannot be read: {error.strerror}; check its name") from error
