"""What every refusal of a bad file has in common."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from volsplat.protocol.text.errors import BadInput


def assert_refused_in_one_line(
    read: Callable[[Path], Any], path: Path, cause: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Reading the file raises BadInput with the cause and the file in one line, and no library prints another."""
    with pytest.raises(BadInput) as refusal:
        read(path)
    text = str(refusal.value)
    assert cause in text and str(path) in text and "\n" not in text
    assert capfd.readouterr() == ("", "")
