"""The person's browser if there is no room for the file that would lead it to the page."""

import socket
import tempfile
from pathlib import Path

import pytest

from volsplat.client.ui.doors.browser_tab import BrowserTab
from volsplat.client.ui.doors.page_address import PageAddress


def test_without_room_for_a_file_the_address_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("volsplat.client.ui.doors.redirect_file._SNAPS", tmp_path / "absent")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))
    with socket.create_server(("127.0.0.1", 0)) as bound:
        address = PageAddress(bound)
        BrowserTab(address, "head").open()
        (line,) = capsys.readouterr().err.splitlines()
        assert line == f"no browser is opened (No such file or directory); open {address.url}"
