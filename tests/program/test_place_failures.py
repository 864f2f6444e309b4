"""Places that the system refuses: one line with cause and cure, and nothing of errors that are about no place."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from volsplat.program.system_failures import place_failure
from volsplat.protocol.text.errors import BadInput


@pytest.mark.parametrize("number", [errno.EACCES, errno.ELOOP, errno.ENAMETOOLONG, errno.EROFS])
def test_a_closed_place_is_the_persons_to_open(number: int) -> None:
    told = place_failure(OSError(number, os.strerror(number), "closed/head.nrrd"))
    assert isinstance(told, BadInput) and str(told).startswith(
        f"closed/head.nrrd: cannot be reached ({os.strerror(number)})"
    )


def test_a_full_place_is_nobodys_mistake() -> None:
    told = place_failure(OSError(errno.ENOSPC, "full", "film.mp4"))
    assert str(told) == "film.mp4 cannot be written: No space left on device; write it elsewhere"
    assert told is not None and not isinstance(told, BadInput)


def test_a_current_folder_that_is_gone_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(FileNotFoundError) as raised:
        os.getcwd()
    assert "the current folder is there no more" in str(place_failure(raised.value))


@pytest.mark.parametrize(
    "error",
    [
        ValueError("no"),
        OSError(errno.EACCES, "no address"),
        FileNotFoundError(errno.ENOENT, "none", "missing"),
        FileNotFoundError(errno.ENOENT, "of a library that names no file"),
    ],
)
def test_what_is_about_no_such_place_goes_on_as_it_is(error: Exception) -> None:
    assert place_failure(error) is None
