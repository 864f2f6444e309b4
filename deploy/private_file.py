"""Files that only their owner may read, and that nobody finds half written."""

import os
from pathlib import Path


def write_private(path: Path, content: bytes) -> None:
    """In the place of what is there, all at once."""
    fresh = path.with_name(f"{path.name}.new")
    with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(content)
    fresh.replace(path)
