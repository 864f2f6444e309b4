"""File names that can be told to others: text, and not any bytes as file systems allow."""

import os

from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import printable


def check_utf8(name: str | os.PathLike[str]) -> None:
    """Raises BadInput for other bytes: no message, no document and no image library takes them."""
    try:
        os.fspath(name).encode()
    except UnicodeEncodeError:
        shown = printable(os.fspath(name))
        if _is_utf8(os.fsencode(name)):
            raise BadInput(f"{shown}: this terminal's language setting is not UTF-8; set LC_ALL=C.UTF-8") from None
        raise BadInput(f"{shown}: this name is not UTF-8; rename it, or link to it by another name") from None


def _is_utf8(name: bytes) -> bool:
    try:
        name.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True
