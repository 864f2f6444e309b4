"""Servers' logs in files that this process can read: their names and their last lines."""

import re
from collections import deque
from pathlib import Path

from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import one_line


def file_name(server: str) -> str:
    """Of the server of this name, without what shells and engines take for more than a letter."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", server)


def last_lines(path: Path, lines: int) -> str:
    """Raises BadInput where there is no such log."""
    try:
        with path.open(encoding="utf-8", errors="replace") as log:
            return "".join(deque(log, lines))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; nothing was logged yet, or not in a folder seen here") from error


def last_line(path: Path) -> str:
    """Empty where there is none."""
    try:
        return one_line(last_lines(path, 1).strip())
    except BadInput:
        return ""
