"""Files that the header of a volume names, for a server that is held to a folder.

The system lets nothing outside be read (see confinement), but tells whether it is there, and how large it is.
"""

from pathlib import Path

from volsplat.protocol.text.errors import BadInput

_folders: list[Path] = []  # that this process is held to, for good


def hold_names_to(folder: Path) -> None:
    """From now on headers may name what lies below this folder alone."""
    _folders.append(folder)


def are_held() -> bool:
    return bool(_folders)


def named_file(header: Path, name: str) -> Path:
    """What a header means by a name. Raises BadInput if that lies outside, whether there is such a file or not."""
    found = header.parent / name
    try:
        inside = all(found.resolve().is_relative_to(folder) for folder in _folders)
    except (OSError, RuntimeError, ValueError):  # a ring of links, or a name that can be none
        inside = not _folders
    if not inside:
        raise BadInput(
            f"{header}: names {name}, which does not lie below this server's --data-root; put it there, or leave it out"
        )
    return found
