"""File names that can be told to others: text, and not any bytes as file systems allow. And URLs of files here."""

import os
import re
from urllib.parse import unquote

from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import printable

FILE_URL = "file://"
_URL = re.compile(r"([A-Za-z][\w+.-]*)://")
THIS_MACHINE = ("", "localhost")  # what RFC 8089 lets stand before a path


def scheme_of(name: str) -> str:
    """What a URL begins with, before ://, in lower case, as RFC 3986 compares it; "" for what is no URL."""
    match = _URL.match(name)
    return match[1].lower() if match else ""


def is_file_url(name: str) -> bool:
    """Whether it is a URL of a file: of this machine, or refused."""
    return f"{scheme_of(name)}://" == FILE_URL


def plain_url(name: str) -> str:
    """The URL with its scheme in lower case, the only one that libraries know; any other name as it is."""
    scheme = scheme_of(name)
    return f"{scheme}{name[len(scheme) :]}"


def path_of(name: str) -> str:
    """The path that a file:// URL names, which may look like a URL itself; any other name as it is.

    Raises BadInput for a URL of another machine's file, and for what can be no file's name.
    """
    path = _path_in(name) if is_file_url(name) else name
    if "\0" in path:
        raise BadInput(f"{printable(name)}: no file's name has a byte of 0; leave it out")
    return path


def _path_in(url: str) -> str:
    host, _, path = url[len(FILE_URL) :].partition("/")
    if host.lower() not in THIS_MACHINE:
        raise BadInput(
            f"{printable(url)}: names the machine {printable(host)}, and {FILE_URL} reaches files of this one alone; "
            f"mount its folder here and give the path without {FILE_URL}"
        )
    return unquote(f"/{path}")


def check_utf8(name: str | os.PathLike[str]) -> None:
    """Raises BadInput for other bytes: no message, no document and no image library takes them."""
    try:
        os.fspath(name).encode()
    except UnicodeEncodeError:
        shown = printable(os.fspath(name))
        if _is_utf8(name):
            raise BadInput(f"{shown}: this terminal's language setting is not UTF-8; set LC_ALL=C.UTF-8") from None
        raise BadInput(f"{shown}: this name is not UTF-8; rename it, or link to it by another name") from None


def _is_utf8(name: str | os.PathLike[str]) -> bool:
    try:
        os.fsencode(name).decode("utf-8")
    except UnicodeError:
        return False
    return True
