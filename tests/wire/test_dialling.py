"""What is tried again, and what a person must put right, where somebody is dialled."""

import errno
import os
import socket
import threading
from typing import Any

import pytest

from support.patience import PATIENCE
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token


def dialled(listener: Listener, token: Any, said: list[str]) -> Connection:
    hello = new_hello(Role.SPLAT_SERVER, data_port=1)

    def report(error: PeerLost) -> None:
        said.append(str(error))

    return connect(listener.address, hello, token, Role.CLIENT, patience=PATIENCE, report=report)


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (socket.gaierror(socket.EAI_AGAIN, "Temporary failure in name resolution"), "cannot be looked up now"),
        (OSError(errno.ENETDOWN, os.strerror(errno.ENETDOWN)), "check the network between"),
        (OSError(errno.EHOSTDOWN, os.strerror(errno.EHOSTDOWN)), "check the network between"),
    ],
)
def test_what_passes_is_waited_for(error: OSError, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As while a machine that has just started brings its network up."""
    token, said, failures = new_token(), list[str](), [error, error]
    real = socket.create_connection

    def at_last(*arguments: Any, **options: Any) -> socket.socket:
        if failures:
            raise failures.pop()
        return real(*arguments, **options)

    monkeypatch.setattr(socket, "create_connection", at_last)
    monkeypatch.setattr("volsplat.protocol.wire.dialling.entered_door", lambda *_: None)
    with Listener(Role.CLIENT, token) as listener:
        accepted: list[Connection | None] = []
        accepting = threading.Thread(target=lambda: accepted.append(listener.accept(PATIENCE)))
        accepting.start()
        with dialled(listener, token, said):
            accepting.join(PATIENCE)
        (near,) = accepted
        assert near is not None and not failures
        near.close()
    assert len(said) == 1 and told in said[0]


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (socket.gaierror(socket.EAI_NONAME, "Name or service not known"), "is unknown; check it"),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE)), "ulimit -n"),
    ],
)
def test_what_stays_is_told_at_once(error: OSError, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any, **__: Any) -> socket.socket:
        raise error

    monkeypatch.setattr(socket, "create_connection", never)
    monkeypatch.setattr("volsplat.protocol.wire.dialling.entered_door", lambda *_: None)
    said: list[str] = []
    token = new_token()
    with Listener(Role.CLIENT, token) as listener, pytest.raises(BadInput, match=told):
        dialled(listener, token, said)
    assert not said
