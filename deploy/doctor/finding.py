"""What the doctor says of one hop to one machine or server."""

from typing import NamedTuple


class Finding(NamedTuple):
    place: str  # the machine or server
    hop: str
    right: bool
    line: str  # what is there; else what is wrong, and the cure
