"""How a person names a volume: a path or URL and, after `#`, the part of it that is meant.

head.nrrd            scans/#1.2.840.113619.2      run.h5#/entry/density      s3://bucket/brain.zarr#2
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.file_names import check_utf8, is_file_url, path_of, plain_url

LONGEST_VOLUME_NAME = 4096  # letters: of a message that has it, and of a path of Linux
MOST_SIGNS = 16  # of parts, of which each may be a letter of a path that is looked for


class VolumeName(NamedTuple):
    """`part` is "" where none is named; what it means is the format's matter."""

    place: str
    part: str

    @property
    def is_url(self) -> bool:
        return "://" in self.place

    @property
    def is_far(self) -> bool:
        """Whether it is a URL, and none of this machine's files."""
        return self.is_url and not is_file_url(self.place)

    @property
    def plain_place(self) -> str:
        """The place as it is opened: of a URL of this machine's files their path, which may look like a URL itself."""
        return plain_url(self.place) if self.is_far else path_of(self.place)

    def __str__(self) -> str:
        return f"{self.place}#{self.part}" if self.part else self.place


def volume_name(text: str, is_there: Callable[[str], bool] = os.path.exists) -> VolumeName:
    """What `text` names: the longest of its possible places that is there, else the shortest, and the part after it.

    So a file or folder whose own name has a `#` is taken as it stands, whatever lies beside it.
    Raises BadInput for what is not UTF-8, too long, can be no file's name, or is a file:// URL of another machine.
    """
    check_name(text)
    shortest, *longer = possible_places(text)
    place = next((one for one in reversed(longer) if is_there(one)), shortest)
    path_of(place)
    return VolumeName(place, text[len(place) + 1 :])


def possible_places(text: str) -> list[str]:
    """What may be the place that `text` names, the shortest first: up to a `#`, or all of it. Of a URL it is known.

    Of more `#` than check_name allows the last ones count.
    """
    ends = [at for at, letter in enumerate(text) if letter == "#"]
    if ends and "://" in text:
        return [text[: ends[0]]]
    return [text[:end] for end in (*ends[-MOST_SIGNS:], len(text))]


def absolute_name(text: str) -> str:
    """The name as another process of this machine, in another folder, must be told it. Raises BadInput likewise."""
    name = volume_name(text)
    if name.is_url:
        return text
    absolute = str(name._replace(place=str(Path(name.place).absolute())))
    check_name(absolute)
    return absolute


def check_is_there(text: str) -> None:
    """Raises BadInput where this machine has no such file or folder; a URL is tried when it is opened."""
    name = volume_name(text)
    if not name.is_url and not Path(name.place).exists():
        raise BadInput(f"{name.place}: no such file or folder")


def check_name(text: str) -> None:
    """Raises BadInput for what no message can hold, and for more places to look at than anybody means."""
    check_utf8(text)
    if len(text) > LONGEST_VOLUME_NAME:
        raise BadInput(
            f"{text[:40]}…: a volume's name of {len(text)} letters is too long; "
            f"give a path and part of at most {LONGEST_VOLUME_NAME}"
        )
    if "://" not in text and (count := text.count("#")) > MOST_SIGNS:
        raise BadInput(
            f"{text[:40]}…: has {count} times the sign #, and a volume's name has it {MOST_SIGNS} times at most; "
            "rename the file, or link to it by another name"
        )
