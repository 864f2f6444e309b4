"""What the part of a volume's name says, for formats that choose by several things: `T2_AX,echo=2` or `c=1,t=0`."""

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from volsplat.protocol.text.errors import BadInput


class PartOptions(NamedTuple):
    """`word` is what stands before the first known key, "" where nothing does."""

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
    if said.isdecimal() and int(said) < count:
        return int(said)
    numbers = f"are numbered 0 to {count - 1}" if count > 1 else "have one number, 0"
    raise BadInput(f"{path}: its {what} {numbers}; “{said}” is none of them")
