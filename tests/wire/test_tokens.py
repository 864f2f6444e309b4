"""The session token: where it comes from, and that nobody else can read it."""

import os
from pathlib import Path

import pytest

from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.tokens import SHORTEST_TOKEN, TOKEN_VARIABLE, Token, find_token, need_token, new_token


def test_tokens_differ_and_are_long() -> None:
    assert new_token().key != new_token().key
    assert len(new_token().key) >= SHORTEST_TOKEN


def test_a_token_comes_through_the_environment() -> None:
    token = new_token()
    environment = token.added_to({"HOME": "/"})
    assert environment["HOME"] == "/"
    assert need_token(environment).key == token.key


def test_a_token_comes_through_a_private_file_which_goes_before_the_environment(tmp_path: Path) -> None:
    token, path = new_token(), tmp_path / "token"
    token.write(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert need_token(new_token().added_to({}), path).key == token.key


def test_a_token_file_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "token"
    path.write_text("mine")
    with pytest.raises(BadInput, match="cannot be made"):
        new_token().write(path)
    assert path.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644])
def test_a_token_file_that_others_can_read_is_refused_with_the_cure(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "token"
    new_token().write(path)
    path.chmod(mode)
    with pytest.raises(BadInput, match="chmod 600"):
        find_token({}, path)


def test_a_token_file_of_somebody_else_s_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "token"
    new_token().write(path)
    if (user := os.geteuid()) == 0:
        os.chown(path, 12345, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    with pytest.raises(BadInput, match="belongs to another user; make one of your own"):
        find_token({}, path)


def test_a_token_file_that_is_no_file_is_refused_with_the_reason(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe, 0o600)
    reasons = {tmp_path / "missing": "No such file", tmp_path: "Is a directory", pipe: "is not a regular file"}
    for path, reason in reasons.items():
        with pytest.raises(BadInput, match=reason):
            find_token({}, path)


@pytest.mark.parametrize("text", ["short", "x" * 5000, "a space in the middle of the token!", "é" * 40])
def test_a_malformed_token_is_refused_without_showing_it(text: str) -> None:
    with pytest.raises(ValueError, match="a token"):
        Token(text)
    with pytest.raises(BadInput) as caught:
        find_token({TOKEN_VARIABLE: text})
    assert text not in str(caught.value) and TOKEN_VARIABLE in str(caught.value)


def test_no_token_at_all_is_one_clear_line() -> None:
    assert find_token({}) is None
    assert find_token({TOKEN_VARIABLE: ""}) is None
    with pytest.raises(BadInput, match="VOLSPLAT_TOKEN or give --token-file"):
        need_token({})
