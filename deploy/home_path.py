"""Paths as people give them, who mean somebody's home by `~`."""

from pathlib import Path

from volsplat.protocol.text.errors import BadInput


def home_path(text: str) -> Path:
    """Raises BadInput where nobody here has this home."""
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        raise BadInput(f"{text}: no such user's home is known here; give the whole path") from error
