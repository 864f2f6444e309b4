"""Folders among the system's temporary ones. Those that killed programs left there end with the next that is made."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from volsplat.client.files.temporary_name import temporary_name


def made_folder() -> Path:
    """An empty one, of this user alone, that somebody else removes. Raises OSError."""
    folder = temporary_name(Path(tempfile.gettempdir(), "folder"))
    folder.mkdir(mode=0o700)
    return folder


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """One that ends with the block. Raises OSError."""
    folder = made_folder()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
