"""What the part of a volume's name says, for formats that choose by several things: `T2_AX,echo=2` or `c=1,t=0`.

Also by a number alone, `series.nii#3`, and how the things to choose from are listed for a person.
"""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from volsplat.mapshade_server.readers.reading.parts import PartNeeded, numbered
from volsplat.protocol.text.errors import BadInput

MOST_LISTED = 12
MOST_DIGITS = 20  # of a number; Python refuses to read endless ones


class PartOptions(NamedTuple):
    """`word` is what stands before the first known key, "" if nothing does."""

    word: str
    values: dict[str, str]


def part_options(part: str, keys: Collection[str]) -> PartOptions:
    """Takes `key=value` of the known `keys` from the end; a word may itself have commas and equals signs."""
    words = part.split(",")
    values: dict[str, str] = {}
    while words:
        key, equals, value = words[-1].partition("=")
        if not equals or key.strip().lower() not in keys:
            break
        values.setdefault(key.strip().lower(), value.strip())
        words.pop()
    return PartOptions(",".join(words).strip(), values)


def index_in(path: Path, said: str, count: int, what: str) -> int:
    """The number from 0 to `count` - 1 that a person said of `what`: frames, channels. Raises BadInput for others."""
    if said.isdecimal() and len(said) <= MOST_DIGITS and int(said) < count:
        return int(said)
    numbers = f"are numbered 0 to {count - 1}" if count > 1 else "have one number, 0"
    raise BadInput(f"{path}: its {what} {numbers}; “{said}” is none of them")


class NumberedVolume(NamedTuple):
    """One of a file's volumes, and what it is called."""

    number: int
    name: str


def chosen_frame(path: Path, part: str, frames: int, names: Sequence[str] = ()) -> NumberedVolume:
    """The volume that `part` names by its number. Raises BadInput if it must be named and is not.

    `names` are what the file calls each of them, empty for one of which it says nothing.
    """
    if frames == 1 and part not in ("", "0"):
        raise BadInput(f"{path}: holds one volume, it has no part “{part}”; leave out #{part}")
    if frames > 1 and not part:
        known = [f"{n} is {name}" for n, name in enumerate(names) if name]
        told = f": {listed(known)}" if known else ""
        line = f"{path}: a series of {frames} volumes, numbered from 0{told}; choose one, as in {path}#0"
        raise PartNeeded(line, numbered(frames, "volume", names=names))
    number = index_in(path, part or "0", frames, "volumes")
    return NumberedVolume(number, f"{path.name}#{number}" if frames > 1 else path.name)


def listed(shown: Sequence[str], nothing: str = "nothing") -> str:
    """The first of what there is, for a person to choose from."""
    more = [f"and {len(shown) - MOST_LISTED} more"] if len(shown) > MOST_LISTED else []
    return ", ".join([*shown[:MOST_LISTED], *more]) or nothing
