"""What is finished, so that a run that was ended at any moment is taken up by the next one.

A small JSON file in a folder `.prepare` within the store, replaced as a whole; the folder goes when all is done.
"""

import errno
import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from volsplat.mapshade_server.held.packet_store import JOURNAL, PREPARING, Source
from volsplat.mapshade_server.prepare.layout import Layout
from volsplat.mapshade_server.prepare.progress import Progress
from volsplat.protocol.text.errors import BadInput

LOCK = "lock"
WITHOUT_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP}  # as Lustre that was mounted without flock has it


class Wish(msgspec.Struct, frozen=True):
    """All that decides the bytes of a store."""

    source: Source
    window: tuple[float, float] | None
    directions: str
    layout: Layout


class State(msgspec.Struct):
    """`shards` has the CRC-32 of the packets of each finished one, by its level and place, as in 0/3/1/0."""

    wish: Wish
    unpacked: bool = False  # the copy of a source that is compressed as a whole
    shards: dict[str, int] = {}


class Journal:
    """The journal of the store at `out`, which this process alone writes."""

    def __init__(self, out: Path, wish: Wish) -> None:
        """Takes up the journal that is there. Raises BadInput if it is of another source or other options."""
        self.folder = out.absolute() / PREPARING  # as all machines know it
        self._path = out / PREPARING / JOURNAL
        self.state = State(wish)
        self.is_new = not self._path.exists()
        if self.is_new:
            self._write()
            return
        try:
            self.state = msgspec.json.decode(self._path.read_bytes(), type=State)
        except msgspec.DecodeError:
            raise BadInput(f"{out}: its journal {self._path} is damaged; delete {out} and begin anew") from None
        check_source(out, self.state.wish.source, wish.source)
        if self.state.wish != wish:
            raise other_options(out)

    def finish_shards(self, checksums: dict[str, int]) -> None:
        self.state.shards.update(checksums)
        self._write()

    def forget_shards(self, names: list[str]) -> None:
        for name in names:
            del self.state.shards[name]
        self._write()

    def finish_unpacking(self) -> None:
        self.state.unpacked = True
        self._write()

    def withdraw(self) -> None:
        """Leave nothing behind: there will be no store."""
        shutil.rmtree(self.folder)
        with suppress(OSError):  # it was there before, with something in it
            self.folder.parent.rmdir()

    def _write(self) -> None:
        fresh = self._path.with_suffix(".new")
        with fresh.open("wb") as file:
            file.write(msgspec.json.encode(self.state))
            file.flush()
            os.fsync(file.fileno())
        os.replace(fresh, self._path)


def check_source(out: Path, began: Source, source: Source) -> None:
    """Raises BadInput if the store at `out` was begun from another source, or from one that was different then."""
    what = began.name
    if began.name == source.name:
        difference = source.identity.difference(began.identity)
        if not difference:
            return
        what = f"{what} as it was before it changed ({difference})"
    raise BadInput(f"{out}: was begun from {what}; delete it, or name another place")


def other_options(out: Path) -> BadInput:
    return BadInput(f"{out}: was begun with other options; give the same, delete it, or name another place")


@contextmanager
def alone(out: Path, progress: Progress) -> Iterator[None]:
    """Keeps other processes from preparing the same store meanwhile. Raises BadInput if one does."""
    folder = out / PREPARING
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BadInput(f"{out}: is being prepared by another process; wait for it, or end it") from None
        except OSError as error:
            if error.errno not in WITHOUT_LOCKS:
                raise
            progress.note(f"{out}: its file system has no locks; see to it that nobody else prepares it meanwhile")
        yield
