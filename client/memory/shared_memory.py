"""Memory without a name that other processes of this machine open by this one's number."""

from __future__ import annotations

import fcntl
import os
import weakref
from typing import Any

import numpy as np

from volsplat.program.machine_limits import available_memory
from volsplat.protocol.description.shared_array import packed_header
from volsplat.protocol.description.volume import SCALAR_BYTES, VolumeDescription
from volsplat.protocol.text.byte_sizes import bytes_text
from volsplat.protocol.text.errors import BadInput

SLAB_BYTES = 1 << 26  # copied at a time, so that what is not in memory yet is never held twice
CHUNK_COPIES = 4  # of chunks, at the most, as they are unpacked, joined and converted
LONGEST_NAME = 200  # bytes; the system takes no more than 249
_NO_CHANGES = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE


class SharedMemory:
    """An open file in memory; closed with the object."""

    def __init__(self, name: str) -> None:
        short = name.replace("\0", " ").encode(errors="replace")[:LONGEST_NAME].decode(errors="ignore")
        self.descriptor = os.memfd_create(short, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        self.place = f"/proc/{os.getpid()}/fd/{self.descriptor}"
        self.close = weakref.finalize(self, os.close, self.descriptor)


def shared_memory(description: VolumeDescription, values: Any) -> SharedMemory:
    """The voxels of an array [k, j, i] with their description before them; nobody can change them any more."""
    _check_room(description)
    memory = SharedMemory(description.name)
    try:
        _write(memory.descriptor, packed_header(description))
        for slab in _slabs(values, description.scalar_type):
            _write(memory.descriptor, memoryview(slab).cast("B"))
    except BadInput:
        memory.close()
        raise
    except (OSError, MemoryError) as error:
        memory.close()
        raise BadInput(f"the array does not fit into this machine's memory once more: {error}") from None
    fcntl.fcntl(memory.descriptor, fcntl.F_ADD_SEALS, _NO_CHANGES)
    return memory


def _check_room(description: VolumeDescription) -> None:
    """Raises BadInput where the voxels would drive other programs out of memory: nothing else limits them."""
    needed, left = description.geometry.box.voxels * SCALAR_BYTES[description.scalar_type], available_memory()
    if needed > left:
        raise BadInput(
            f"the array takes {bytes_text(needed)} once more, and {bytes_text(left)} of memory are left; "
            "save it as a file, as a Zarr store, and prepare that (volsplat prepare)"
        )


def _slabs(values: Any, scalar_type: str) -> Any:
    """Whole sheets in order: dask and zarr compute and read no more of them at once. Raises BadInput.

    Chunks are computed and unpacked once each, as long as those that lie beside one another fit into memory.
    """
    sheets, rows, columns = values.shape
    sheet_bytes, chunk = rows * columns * np.dtype(scalar_type).itemsize, _chunk(values)
    step = max(1, SLAB_BYTES // sheet_bytes)
    if step > chunk or (sheets + CHUNK_COPIES * chunk) * sheet_bytes <= available_memory():
        step += -step % chunk
    for first in range(0, sheets, step):
        yield _read(values, slice(first, first + step), scalar_type)


def _read(values: Any, sheets: slice, scalar_type: str) -> Any:
    try:
        return np.ascontiguousarray(values[sheets], scalar_type)
    except TypeError as error:  # as of arrays on a GPU, which say how to fetch them
        raise BadInput(f"the array gives no numbers that could be drawn: {error}") from None
    except (OSError, RuntimeError) as error:  # of the file or store that it is read from
        raise BadInput(f"the array cannot be read: {error}") from None


def _chunk(values: Any) -> int:
    """Sheets that come together at the least, of an array that comes in chunks."""
    chunks = getattr(values, "chunksize", None) or getattr(values, "chunks", None)
    return int(chunks[0]) if chunks and isinstance(chunks[0], int) else 1


def _write(descriptor: int, data: bytes | memoryview) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]
