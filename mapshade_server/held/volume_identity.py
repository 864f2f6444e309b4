"""The identity of the volume that a reader has opened, and its refusal if another one was described.

Looks at all bytes of a small volume, and of any other at a few hundred KiB that lie evenly over all files.
"""

import hashlib
import os
import socket
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import TypeVar

from volsplat.mapshade_server.held.packet_store import PacketStore, open_store
from volsplat.mapshade_server.readers import VolumeReader, open_volume
from volsplat.mapshade_server.readers.reading.volume_files import Opened, Span, VolumeFile, files_of
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.description.volume_name import VolumeName, volume_name
from volsplat.protocol.text.errors import BadInput

HEADER_BYTES = 1024
WHOLE_BYTES = 4 << 20  # up to which a volume is looked at as a whole, in some milliseconds
WHOLE_BLOCK_BYTES = 1 << 20
BLOCKS = 64  # of a larger one
BLOCK_BYTES = 4096
DIGEST_BYTES = 16

_Opened = TypeVar("_Opened", bound=Opened)


def identified_volume(volume: str) -> tuple[OpenedVolume, VolumeIdentity]:
    """A volume's reader, and the identity of what it has opened. Raises BadInput."""
    return _identified(volume, open_volume)


def identified_store(place: str) -> tuple[PacketStore, VolumeIdentity]:
    """A packet store, and its identity. Raises BadInput."""
    return _identified(place, open_store)


def described_volume(volume: str, described: VolumeIdentity) -> OpenedVolume:
    """The reader of the volume that was described. Raises BadInput if there is another one by now."""
    return _described(volume, described, open_volume)


def checked_volume(volume: str, described: VolumeIdentity) -> tuple[VolumeReader, Callable[[], None]]:
    """As `described_volume`, with what raises BadInput if the volume was changed since."""
    opened = described_volume(volume, described)
    return opened, lambda: check_still(volume, opened, described)


def described_store(place: str, described: VolumeIdentity) -> PacketStore:
    """The packet store that was described. Raises BadInput if there is another one by now."""
    return _described(place, described, open_store)


def check_still(volume: str, opened: Opened, described: VolumeIdentity) -> None:
    """Raises BadInput if the volume was changed while it was read."""
    check_identity(volume, identity_of(volume, opened), described)


def identity_of(volume: str, opened: Opened) -> VolumeIdentity:
    """The identity of what is `opened` by this name now. Raises BadInput if its files cannot be looked at."""
    name = volume_name(volume)
    try:
        files = files_of(opened, Path(name.plain_place))
        states = [file.state() for file in files]
        contents = _digest(_blocks(files, [state.size for state in states]))
        first = files[0].read([Span(0, HEADER_BYTES)]) if files else []
        lies_at = _place(name)
    except OSError as error:
        raise BadInput(f"{volume}: cannot be read any more ({error.strerror or error}); put it back") from None
    description, dims = opened.description, ",".join(map(str, opened.description.geometry.dims))
    return VolumeIdentity(
        size=sum(state.size for state in states),
        header=_digest([f"{dims} {description.scalar_type}".encode(), *first]),
        contents=contents,
        times=_digest([f"{state.size} {state.changed}".encode() for state in states]),
        place=_digest([os.fsencode(part) for part in lies_at]),
    )


def check_identity(volume: str, found: VolumeIdentity, described: VolumeIdentity) -> None:
    """Raises BadInput unless what is found by this name is what was described."""
    difference = found.difference(described)
    if not difference:
        return
    name = volume_name(volume)
    shown = volume if name.is_url else str(name._replace(place=os.path.abspath(name.place)))
    if found.is_at_the_place_of(described):
        raise BadInput(
            f"{shown}: was replaced or changed after it was opened: {difference}; open it again to see what it is now"
        )
    raise BadInput(
        f"{shown}: is another volume here than the one that another server has described: {difference}; "
        "give every server the same volume"
    )


def _described(volume: str, described: VolumeIdentity, open_by: Callable[[str], _Opened]) -> _Opened:
    opened, identity = _identified(volume, open_by)
    check_identity(volume, identity, described)
    return opened


def _identified(volume: str, open_by: Callable[[str], _Opened]) -> tuple[_Opened, VolumeIdentity]:
    """What is opened by a name that means the same before and after: its header and its bytes belong together."""
    before = _stamp(volume)
    opened = open_by(volume)
    identity = identity_of(volume, opened)
    if _stamp(volume) != before:
        raise BadInput(f"{volume}: is being changed while it is opened; wait until that is over")
    return opened, identity


def _stamp(volume: str) -> tuple[int, int, int] | None:
    """None of what is no file here: opening it will say so."""
    try:
        stat = os.stat(volume_name(volume).plain_place)
    except OSError:
        return None
    return (stat.st_ino, stat.st_size, stat.st_mtime_ns)


def _blocks(files: Sequence[VolumeFile], sizes: Sequence[int]) -> Iterator[bytes]:
    """All bytes if they are no more than WHOLE_BYTES, else some that lie evenly over all files, as if they were one."""
    ends = list(accumulate(sizes))
    total = ends[-1] if ends else 0
    if total <= WHOLE_BYTES:
        block, at_once, starts = WHOLE_BLOCK_BYTES, 1, list(range(0, total, WHOLE_BLOCK_BYTES))
    else:
        block, at_once = BLOCK_BYTES, BLOCKS
        starts = [n * (total - block) // (BLOCKS - 1) for n in range(BLOCKS)]
    spans: dict[int, list[Span]] = defaultdict(list)
    for start in starts:
        end = min(start + block, total)
        while start < end:  # a block may go on in the next file
            n = bisect_right(ends, start)
            stop = min(end, ends[n])
            spans[n].append(Span(start - ends[n] + sizes[n], stop - start))
            start = stop
    for n, of_file in spans.items():
        for first in range(0, len(of_file), at_once):
            yield from files[n].read(of_file[first : first + at_once])


def _place(name: VolumeName) -> list[str]:
    """What only this place has: files of one path may be others on other machines, and in other containers."""
    if name.is_far:
        return [name.plain_place]
    path = os.path.abspath(name.plain_place)
    return [socket.gethostname(), str(os.stat(os.path.dirname(path)).st_dev), path]


def _digest(parts: Iterable[bytes]) -> str:
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()
