"""Folders among the system's temporary ones. Those that killed programs left there end with the next that is made."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from volsplat.program.temporary_name import temporary_name
from volsplat.protocol.text.errors import BadInput


def made_folder() -> Path:
    """An empty one, of this user alone, that somebody else removes. Raises BadInput if there can be none."""
    try:
        folder = temporary_name(Path(tempfile.gettempdir(), "folder"))
        folder.mkdir(mode=0o700)
    except OSError as error:
        raise no_temporary("folder", error) from error
    return folder


def no_temporary(what: str, error: OSError) -> BadInput:
    """What to raise if what should lie among the system's temporary files cannot be made or written."""
    return BadInput(
        f"there can be no temporary {what}: {error.strerror or error}; free space there, or set TMPDIR to another "
        "folder where volsplat runs"
    )


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """One that ends with the block. Raises BadInput."""
    folder = made_folder()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
