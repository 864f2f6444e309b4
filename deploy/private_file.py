"""Files that only their owner may read, and that nobody finds half written."""

import os
from contextlib import suppress
from pathlib import Path

from volsplat.protocol.text.errors import BadInput


def write_private(path: Path, content: bytes) -> None:
    """In the place of what is there, all at once. Raises BadInput if it cannot be; what was there stays."""
    fresh = path.with_name(f"{path.name}.new")
    try:
        with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
            file.write(content)
        fresh.replace(path)
    except OSError as error:
        with suppress(OSError):
            fresh.unlink(missing_ok=True)
        raise BadInput(
            f"{path} cannot be written: {error.strerror}; make room there, or give another folder"
        ) from error
