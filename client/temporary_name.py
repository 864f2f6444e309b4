"""Where a file is written before it takes its name, so that whoever looks finds the old one or a whole one."""

import secrets
from pathlib import Path


def temporary_name(path: Path) -> Path:
    """A name beside `path`, of the same kind, that is renamed to it once the file is whole."""
    return path.with_name(f".volsplat-{secrets.token_hex(8)}{path.suffix.lower()}")
