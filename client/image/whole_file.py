"""A file that takes its name once it is whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from volsplat.client.image.temporary_name import behind_links, temporary_name
from volsplat.protocol.text.errors import BadInput


@contextmanager
def whole_file(path: Path, refused: str = "cannot be written") -> Iterator[BinaryIO]:
    """What is written lies at `path` after the block, or if that fails, what was there before.

    Raises BadInput if it cannot be written, as on a full disk: the path, what is `refused` and the system's words.
    """
    target = behind_links(path)
    temporary = temporary_name(target)
    try:
        with temporary.open("wb") as file:
            yield file
        os.replace(temporary, target)
    except OSError as error:
        raise BadInput(f"{path}: {refused}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
