"""Deflated HDF5 chunks, unpacked within the size that the dataset promises.

HDF5 itself unpacks a deflated chunk to wherever it ends, which may be beyond any memory.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.hdf5_file import h5py
from volsplat.mapshade_server.readers.reading.bounded_unpacking import inflated

DEFLATE, SHUFFLE, FLETCHER32 = 1, 2, 3  # HDF5's numbers of filters
CHECKSUM_BYTES = 4
SLACK = 1 << 16  # bytes that filters before deflation may add

Selection = Sequence[int | slice]


def read_selection(dataset: Any, selection: Selection) -> NDArray[Any]:
    """What the selection has of the dataset, as h5py reads it. Raises ValueError for too much, and what h5py raises."""
    filters = _filters(dataset)
    if DEFLATE not in filters or not dataset.chunks:
        values: NDArray[Any] = dataset[tuple(selection)]
        return values
    most = math.prod(dataset.chunks) * dataset.dtype.itemsize + SLACK
    if filters in ([DEFLATE], [SHUFFLE, DEFLATE]) and _is_stored_plainly(dataset):
        return _unpacked(dataset, selection, filters, most)
    chunks = _PackedChunks(dataset)
    for offsets in _touched(dataset, selection):  # to be unpacked once more by HDF5, through all of its filters
        _check(chunks.at(offsets), filters, most)
    checked: NDArray[Any] = dataset[tuple(selection)]
    return checked


def _filters(dataset: Any) -> list[int]:
    creation = dataset.id.get_create_plist()
    return [creation.get_filter(n)[0] for n in range(creation.get_nfilters())]


def _is_stored_plainly(dataset: Any) -> bool:
    h5t = h5py().h5t
    kind = dataset.dtype
    return bool(kind.kind in "iuf" and dataset.id.get_type().equal(h5t.py_create(kind)))


def _ranges(dataset: Any, selection: Selection) -> list[range]:
    return [
        range(part, part + 1) if isinstance(part, int) else range(*part.indices(length))
        for part, length in zip(selection, dataset.shape, strict=True)
    ]


def _touched(dataset: Any, selection: Selection) -> Iterator[tuple[int, ...]]:
    """Where the chunks begin that share voxels with the selection."""
    axes = [
        range(wanted.start // size * size, wanted.stop, size)
        for wanted, size in zip(_ranges(dataset, selection), dataset.chunks, strict=True)
    ]
    yield from product(*axes)


class _PackedChunks:
    """A dataset's chunks as they are stored. To tell which there are, HDF5 walks through all: that is done once."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    def at(self, offsets: tuple[int, ...]) -> tuple[int, bytes] | None:
        """Which filters were left out (as bits) and the bytes of a chunk, None if it was never written."""
        try:
            left_out, packed = self._dataset.id.read_direct_chunk(offsets)
        except (LookupError, OSError, RuntimeError, ValueError):  # for damaged chunks as for those that are not there
            if offsets in self._written:
                raise
            return None
        return left_out, packed

    @cached_property
    def _written(self) -> frozenset[tuple[int, ...]]:
        """Where the chunks begin that were written."""
        found: list[tuple[int, ...]] = []
        self._dataset.id.chunk_iter(lambda chunk: found.append(tuple(chunk.chunk_offset)))
        return frozenset(found)


def _check(found: tuple[int, bytes] | None, filters: list[int], most: int) -> None:
    """Raises ValueError if the chunk would become too much."""
    place = filters.index(DEFLATE)
    if found is not None and not found[0] >> place & 1 and all(one == FLETCHER32 for one in filters[place + 1 :]):
        packed = found[1]
        added = sum(not found[0] >> n & 1 for n in range(place + 1, len(filters))) * CHECKSUM_BYTES
        inflated(packed[: len(packed) - added], most)


def _unpacked(dataset: Any, selection: Selection, filters: list[int], most: int) -> NDArray[Any]:
    wanted, chunks = _ranges(dataset, selection), _PackedChunks(dataset)
    values = np.full([len(each) for each in wanted], dataset.fillvalue, dataset.dtype)
    for offsets in _touched(dataset, selection):
        found = chunks.at(offsets)
        if found is None:
            continue
        chunk = _chunk(dataset, *found, filters, most)
        into, taken = [], []
        for each, start, size in zip(wanted, offsets, dataset.chunks, strict=True):
            low, high = max(each.start, start), min(each.stop, start + size)
            into.append(slice(low - each.start, high - each.start))
            taken.append(slice(low - start, high - start))
        values[tuple(into)] = chunk[tuple(taken)]
    return values.reshape([len(each) for each, part in zip(wanted, selection, strict=True) if isinstance(part, slice)])


def _chunk(dataset: Any, left_out: int, packed: bytes, filters: list[int], most: int) -> NDArray[Any]:
    stored = packed
    for n in reversed(range(len(filters))):
        if left_out >> n & 1:
            continue
        stored = inflated(stored, most) if filters[n] == DEFLATE else _unshuffled(stored, dataset.dtype.itemsize)
    count = math.prod(dataset.chunks)
    if len(stored) != count * dataset.dtype.itemsize:
        raise ValueError(f"a chunk has {len(stored)} bytes instead of {count * dataset.dtype.itemsize}")
    return np.frombuffer(stored, dataset.dtype).reshape(dataset.chunks)


def _unshuffled(stored: bytes, itemsize: int) -> bytes:
    """First all first bytes, then all second ones, and so on, become numbers."""
    whole = len(stored) // itemsize * itemsize
    return np.frombuffer(stored[:whole], np.uint8).reshape(itemsize, -1).T.tobytes() + stored[whole:]
