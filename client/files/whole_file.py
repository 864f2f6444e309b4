"""A file that takes its name once it is whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from volsplat.program.temporary_name import behind_links, take_mode, temporary_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.open_streams import stream_number, to_open


@contextmanager
def whole_file(path: Path, refused: str = "cannot be written") -> Iterator[BinaryIO]:
    """What is written lies at `path` after the block, or if that fails, what was there before.

    A pipe, a device, and what is open already, such as /dev/stdout, are written into. Raises BadInput if it cannot be
    written, as on a full disk: the path, what is `refused` and the system's words.
    """
    try:
        with open(to_open(path), "wb") if is_stream(path) else _replacing(path) as file:
            yield file
    except OSError as error:
        raise BadInput(f"{path}: {refused}: {error.strerror or error}") from error


def is_stream(path: Path) -> bool:
    """Whether it is written into where it is, since nothing can take its place."""
    return stream_number(path) is not None or path.exists() and not path.is_file()


@contextmanager
def _replacing(path: Path) -> Iterator[BinaryIO]:
    target = behind_links(path)
    temporary = temporary_name(target)
    try:
        with temporary.open("wb") as file:
            take_mode(temporary, target)
            yield file
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
