"""Names of what a process has open already, such as /dev/stdout: it is written on where it stands, and not replaced."""

import os
import re
from pathlib import Path

STANDARD = {"/dev/stdin": 0, "/dev/stdout": 1, "/dev/stderr": 2}


def stream_number(path: Path) -> int | None:
    """The number under which the process has it open; None for a file by its own name."""
    numbered = re.fullmatch(r"/(?:dev|proc/self)/fd/(\d+)", str(path))
    return int(numbered[1]) if numbered else STANDARD.get(str(path))


def to_open(path: Path) -> Path | int:
    """What `open` is given to write: the path, or a number of its own for what is open already. Raises OSError."""
    number = stream_number(path)
    return path if number is None else os.dup(number)
