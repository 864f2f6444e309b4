"""What servers are about to take of their machine's memory, so that no two of them count on the same.

A server writes its promise into a slot of a file that all of this user's servers share, and makes it smaller as it
takes what it promised. It holds a lock on the slot: the promise of a process that has ended counts for nothing.
"""

import fcntl
import logging
import os
import stat
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER = Path("/dev/shm")  # in memory, and of this machine or container alone
SLOTS = 1024
AMOUNT = struct.Struct("<q")  # bytes
GATE = SLOTS * AMOUNT.size  # the byte beyond them is locked while a promise is made
LOOK_SECONDS = 0.1  # between two looks at what has been taken
STATUS = Path("/proc/self/status")

log = logging.getLogger(__name__)


class MemoryPromises:
    """One process's: locks are the process's, so that it may have no two of a folder. Any thread may call it."""

    def __init__(self, folder: Path = FOLDER) -> None:
        """Where the system has no such folder, or somebody else has taken the file, nobody is told of promises."""
        self._file = _opened(folder / f"volsplat-memory-{os.geteuid()}")
        self._slot = None if self._file is None else _free_slot(self._file)
        self._changed = threading.Condition()
        self._aim: int | None = None  # bytes of memory of its own that this process will have; None: nothing promised
        self._telling: threading.Thread | None = None

    def claim(self, grows: int, has_room: Callable[[int], None]) -> None:
        """Promise that this process will grow by so many bytes, unless `has_room` raises.

        It is called with the bytes that others have promised and not taken yet, and nobody promises meanwhile.
        """
        with self._alone() as others:
            has_room(others)
            with self._changed:
                self._aim = _own_memory() + max(grows, 0)
                self._tell()
                if self._telling is None and self._slot is not None:
                    self._begin_to_tell()

    def settle(self) -> None:
        """All that was promised has been taken, or will not be."""
        with self._changed:
            if self._aim is not None:
                self._aim = None
                self._tell()
                self._changed.notify_all()

    def _begin_to_tell(self) -> None:
        telling = threading.Thread(target=self._tell_on, name="memory promised", daemon=True)
        try:
            telling.start()
        except RuntimeError as error:  # the system has no thread left: the promise stays whole until it is settled
            log.debug("other servers are not told what has been taken of what is promised: %s", error)
        else:
            self._telling = telling

    @contextmanager
    def _alone(self) -> Iterator[int]:
        """What others have promised, while no other process looks at it."""
        if self._file is None or self._slot is None:
            yield 0
            return
        fcntl.lockf(self._file, fcntl.LOCK_EX, 1, GATE)
        try:
            yield sum(_promised(self._file, slot) for slot in range(SLOTS) if slot != self._slot)
        finally:
            fcntl.lockf(self._file, fcntl.LOCK_UN, 1, GATE)

    def _tell_on(self) -> None:
        with self._changed:
            while self._aim is not None:
                self._changed.wait(LOOK_SECONDS)
                self._tell()
            self._telling = None

    def _tell(self) -> None:
        if self._file is not None and self._slot is not None:
            left = 0 if self._aim is None else max(self._aim - _own_memory(), 0)
            try:
                os.pwrite(self._file, AMOUNT.pack(left), self._slot * AMOUNT.size)
            except OSError as error:  # the file system is full, or may not be written any more
                log.debug("other servers are not told what memory is promised: %s", error)


def _opened(path: Path) -> int | None:
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        log.debug("servers of this machine promise no memory to each other: %s", error)
        return None
    told = os.fstat(file)
    if told.st_uid == os.geteuid() and stat.S_ISREG(told.st_mode):
        return file
    os.close(file)
    log.warning("%s is not this user's; servers of this machine promise no memory to each other", path)
    return None


def _free_slot(file: int) -> int | None:
    for slot in range(SLOTS):
        with suppress(OSError):  # somebody has it
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, AMOUNT.size, slot * AMOUNT.size)
            os.pwrite(file, AMOUNT.pack(0), slot * AMOUNT.size)
            return slot
    return None


def _promised(file: int, slot: int) -> int:
    """What a living process has in this slot."""
    written = os.pread(file, AMOUNT.size, slot * AMOUNT.size)
    if len(written) < AMOUNT.size or (amount := AMOUNT.unpack(written)[0]) <= 0:
        return 0
    try:
        fcntl.lockf(file, fcntl.LOCK_SH | fcntl.LOCK_NB, AMOUNT.size, slot * AMOUNT.size)
    except OSError:
        return int(amount)
    fcntl.lockf(file, fcntl.LOCK_UN, AMOUNT.size, slot * AMOUNT.size)
    return 0


def _own_memory() -> int:
    """Bytes that only this process has, files mapped into it left out; 0 if the system does not say."""
    with suppress(OSError):
        for line in STATUS.read_text(encoding="ascii").splitlines():
            if line.startswith("RssAnon:"):
                return int(line.split()[1]) << 10
    return 0
