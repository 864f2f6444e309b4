"""Names of the files that a tab's browser saves; each lies in a folder here first, under the same name."""

import re

from volsplat.protocol.text.errors import BadInput

LONGEST_NAME = 255  # bytes, the ending among them: file systems count no letters
LONGEST_ENDING = 5  # bytes


def saved_name(stem: str, ending: str) -> str:
    """The name that a person has typed, with its ending. Raises BadInput for what names no file."""
    if not re.fullmatch(r"[^./\\\x00-\x1f][^/\\\x00-\x1f]*", stem) or not stem.strip():
        raise BadInput("name: give one of more than blanks that does not begin with a dot, without slashes")
    name = f"{stem}{ending}"
    try:
        length = len(name.encode())
    except UnicodeEncodeError:  # half a pair of UTF-16, which a browser may send
        raise BadInput("name: it has a letter that UTF-8 cannot hold; type it anew") from None
    if length > LONGEST_NAME:
        raise BadInput(
            f"name: it takes {length} bytes with {ending}, and a file's takes {LONGEST_NAME} at most; "
            "give a shorter one"
        )
    return name


def stem_of(volume: str) -> str:
    """What files are named by a volume's name: without its suffixes, and with room for any ending."""
    stem = re.sub(r"\W+", "-", volume.split(".")[0]).encode()[: LONGEST_NAME - LONGEST_ENDING]
    return stem.decode(errors="ignore").strip("-") or "volume"
