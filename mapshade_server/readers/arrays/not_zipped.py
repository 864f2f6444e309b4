"""For formats that are read in place, which a gzip file around them prevents."""

from pathlib import Path

from volsplat.protocol.errors import BadInput


def check_not_zipped(path: Path) -> None:
    """Raises BadInput where the file as a whole is compressed by gzip."""
    with path.open("rb") as file:
        if file.read(2) == b"\x1f\x8b":
            raise BadInput(f"{path}: is compressed by gzip as a whole and cannot be read in place; unpack it by gunzip")
