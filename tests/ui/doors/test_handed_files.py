"""Files that a tab's browser saves, on a machine that has no room for them."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import pytest

from volsplat.client.ui.doors.handed_files import hand_bytes
from volsplat.protocol.text.errors import BadInput


def test_without_a_temporary_folder_the_person_hears_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(BadInput, match="No such file or directory; free space there, or set TMPDIR"):
        asyncio.run(hand_bytes(b"\x89PNG", "head.png"))


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(BadInput, match="File name too long; free space there"):
        asyncio.run(hand_bytes(b"\x89PNG", "n" * 300))
    assert list(tmp_path.iterdir()) == []
