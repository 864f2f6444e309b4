"""Memory without a name that other processes of this machine open by this one's number."""

from __future__ import annotations

import fcntl
import mmap
import os
import weakref
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from volsplat.client.memory.library_errors import library_errors
from volsplat.program.machine_limits import available_memory
from volsplat.protocol.description.shared_array import PAGE_BYTES, key_of, packed_header
from volsplat.protocol.description.volume import SCALAR_BYTES, VolumeDescription
from volsplat.protocol.text.byte_sizes import bytes_text
from volsplat.protocol.text.errors import BadInput

BYTES_AT_ONCE = 1 << 26  # copied at a time, so that what is not in memory yet is never held twice
CHUNK_COPIES = 4  # of chunks, at the most, as they are unpacked, joined and converted
LONGEST_NAME = 200  # bytes; the system takes no more than 249
_NO_CHANGES = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE


class SharedMemory:
    """An open file in memory that nobody can change any more; closed with the object."""

    def __init__(self, name: str, parts: Iterable[bytes | memoryview]) -> None:
        """Raises BadInput where these do not fit into memory."""
        short = name.replace("\0", " ").encode(errors="replace")[:LONGEST_NAME].decode(errors="ignore")
        self._descriptor = os.memfd_create(short, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        self.close = weakref.finalize(self, os.close, self._descriptor)
        try:
            for part in parts:
                _write(self._descriptor, part)
            fcntl.fcntl(self._descriptor, fcntl.F_ADD_SEALS, _NO_CHANGES)
        except (OSError, MemoryError) as error:
            self.close()
            raise BadInput(f"the array does not fit into this machine's memory once more: {error}") from None
        except BaseException:
            self.close()
            raise

    @property
    def place(self) -> str:
        """The name by which processes of this machine open it. Raises BadInput once it is closed.

        It has the array's key, since the number may be another one's when a server gets to it.
        """
        self.check_open()
        head = os.pread(self._descriptor, PAGE_BYTES, 0)
        return f"/proc/{os.getpid()}/fd/{self._descriptor}#{key_of(head)}"

    def contents(self) -> bytes:
        """All of it, header and voxels. Raises BadInput once it is closed."""
        self.check_open()
        with mmap.mmap(self._descriptor, 0, prot=mmap.PROT_READ) as mapped:
            return mapped[:]

    def check_open(self) -> None:
        """Raises BadInput once it is closed."""
        if not self.close.alive:
            raise BadInput("this volume is closed; make it anew, as by Volume(array)")


def shared_memory(description: VolumeDescription, values: Any) -> SharedMemory:
    """The voxels of an array [k, j, i] with their description before them. Raises BadInput."""
    _check_room(description.geometry.box.voxels * SCALAR_BYTES[description.scalar_type])
    sheets = (memoryview(some).cast("B") for some in _sheets(values, description.scalar_type))
    return SharedMemory(description.name, chain([packed_header(description)], sheets))


def copied_memory(name: str, contents: bytes) -> SharedMemory:
    """What another process, or this one, has shared. Raises BadInput."""
    _check_room(len(contents))
    return SharedMemory(name, [contents])


def _check_room(needed: int) -> None:
    """Raises BadInput where so many bytes would drive other programs out of memory: nothing else limits them."""
    left = available_memory()
    if needed > left:
        raise BadInput(
            f"the array takes {bytes_text(needed)} once more, and {bytes_text(left)} of memory are left; "
            "save it as a file, as a Zarr store, and prepare that (volsplat prepare)"
        )


def _sheets(values: Any, scalar_type: str) -> Iterator[Any]:
    """Whole sheets in order: dask and zarr compute and read no more of them at once. Raises BadInput.

    Chunks are computed and unpacked once each, as long as those that lie beside one another fit into memory.
    """
    sheets, rows, columns = values.shape
    sheet_bytes, chunk = rows * columns * np.dtype(scalar_type).itemsize, _chunk(values)
    step = max(1, BYTES_AT_ONCE // sheet_bytes)
    if step > chunk or (sheets + CHUNK_COPIES * chunk) * sheet_bytes <= available_memory():
        step += -step % chunk
    for first in range(0, sheets, step):
        yield _read(values, slice(first, first + step), scalar_type)


def _read(values: Any, sheets: slice, scalar_type: str) -> Any:
    with library_errors("the array"):
        read = np.ascontiguousarray(values[sheets], scalar_type)
    promised = (len(range(*sheets.indices(values.shape[0]))), *values.shape[1:])
    if read.shape != promised:
        raise BadInput(f"the array gave {read.shape} numbers where it had promised {promised}; compute it first")
    return read


def _chunk(values: Any) -> int:
    """Sheets that come together at the least, of an array that comes in chunks."""
    chunks = getattr(values, "chunksize", None) or getattr(values, "chunks", None)
    return int(chunks[0]) if chunks and isinstance(chunks[0], int) else 1


def _write(descriptor: int, data: bytes | memoryview) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]
