"""Deflated HDF5 chunks, unpacked within the size that the dataset promises.

HDF5 itself unpacks a deflated chunk to wherever it ends, which may be beyond any memory.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.hdf5_file import h5py
from volsplat.mapshade_server.readers.arrays.hdf5_sources import Part, sources
from volsplat.mapshade_server.readers.reading.bounded_unpacking import check_promise, inflated

DEFLATE, SHUFFLE, FLETCHER32 = 1, 2, 3  # HDF5's numbers of filters
CHECKSUM_BYTES = 4
SLACK = 1 << 16  # bytes that filters before deflation may add, beside a thousandth

Selection = Sequence[int | slice]


class _Filter(NamedTuple):
    """One of those that a chunk went through, the first of them first."""

    number: int
    item_bytes: int  # of what is shuffled, 0 for others


def read_selection(dataset: Any, selection: Selection) -> NDArray[Any]:
    """What the selection has of the dataset, as h5py reads it. Raises ValueError for too much, and what h5py raises."""
    filters = _filters(dataset)
    if DEFLATE in {one.number for one in filters} <= {DEFLATE, SHUFFLE} and _is_stored_plainly(dataset):
        return _unpacked(dataset, selection, filters)
    _check_bounded(dataset, _ranges(dataset, selection))
    values: NDArray[Any] = dataset[tuple(selection)]
    return values


def _check_bounded(dataset: Any, wanted: Part) -> None:
    """Raises ValueError, or BadInput, if HDF5 would unpack more than is promised to read this part."""
    for one, parts in sources(dataset, wanted) if dataset.is_virtual else [(dataset, [wanted])]:
        check_chunks(one.file.filename, one)
        _check_unpacked(one, parts)


def _check_unpacked(dataset: Any, parts: Collection[Part]) -> None:
    """Raises ValueError for chunks with values of these parts that unpack to more than is promised, or to any size."""
    filters = _filters(dataset)
    numbers = [one.number for one in filters]
    if DEFLATE not in numbers:
        return
    deflated = numbers.index(DEFLATE)
    if unknown := set(numbers[deflated:]) - {DEFLATE, SHUFFLE, FLETCHER32}:
        raise ValueError(
            f"it is deflated and then packed by filter {min(unknown)}, so that nothing bounds it; use h5repack"
        )
    chunks = _PackedChunks(dataset)
    touched = dict.fromkeys(offsets for part in parts for offsets in _touched(dataset, part))
    for offsets in touched:  # to be unpacked once more by HDF5, through all of its filters
        if (found := chunks.at(offsets)) is not None:
            _through(*found, filters, deflated, _most(dataset))


def check_chunks(source: str, dataset: Any) -> None:
    """Raises BadInput if its chunks are promised to be far more than the whole."""
    if dataset.chunks:
        check_promise(source, math.prod(dataset.chunks) * dataset.dtype.itemsize, dataset.nbytes)


def _most(dataset: Any) -> int:
    """Bytes that a chunk may become."""
    whole = math.prod(dataset.chunks) * dataset.id.get_type().get_size()
    return int(whole + (whole >> 10) + SLACK)


def _filters(dataset: Any) -> list[_Filter]:
    creation = dataset.id.get_create_plist()
    told = [creation.get_filter(n) for n in range(creation.get_nfilters())]
    return [_Filter(number, values[0] if number == SHUFFLE and values else 0) for number, _, values, _ in told]


def _is_stored_plainly(dataset: Any) -> bool:
    h5t = h5py().h5t
    kind = dataset.dtype
    return bool(kind.kind in "iuf" and dataset.id.get_type().equal(h5t.py_create(kind)))


def _ranges(dataset: Any, selection: Selection) -> Part:
    return tuple(
        range(part, part + 1) if isinstance(part, int) else range(*part.indices(length))
        for part, length in zip(selection, dataset.shape, strict=True)
    )


def _touched(dataset: Any, wanted: Part) -> Iterator[tuple[int, ...]]:
    """Where the chunks begin that share voxels with what is wanted."""
    axes = [range(one.start // size * size, one.stop, size) for one, size in zip(wanted, dataset.chunks, strict=True)]
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


def _unpacked(dataset: Any, selection: Selection, filters: list[_Filter]) -> NDArray[Any]:
    most = _most(dataset)
    wanted, chunks = _ranges(dataset, selection), _PackedChunks(dataset)
    values = np.full([len(each) for each in wanted], dataset.fillvalue, dataset.dtype)
    for offsets in _touched(dataset, wanted):
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


def _chunk(dataset: Any, left_out: int, packed: bytes, filters: list[_Filter], most: int) -> NDArray[Any]:
    stored = _through(left_out, packed, filters, 0, most)
    count = math.prod(dataset.chunks)
    if len(stored) != count * dataset.dtype.itemsize:
        raise ValueError(f"a chunk has {len(stored)} bytes instead of {count * dataset.dtype.itemsize}")
    return np.frombuffer(stored, dataset.dtype).reshape(dataset.chunks)


def _through(left_out: int, packed: bytes, filters: list[_Filter], first: int, most: int) -> bytes:
    """What a chunk becomes back through its filters to the `first`. Raises ValueError for too much."""
    for n in reversed(range(first, len(filters))):
        if left_out >> n & 1:
            continue
        if filters[n].number == DEFLATE:
            packed = inflated(packed, most)
        elif filters[n].number == SHUFFLE:
            packed = _unshuffled(packed, filters[n].item_bytes)
        else:
            packed = packed[:-CHECKSUM_BYTES]
    return packed


def _unshuffled(stored: bytes, item_bytes: int) -> bytes:
    """First all first bytes, then all second ones, and so on, become numbers."""
    if item_bytes < 1:
        raise ValueError("its shuffle filter states no size")
    whole = len(stored) // item_bytes * item_bytes
    return np.frombuffer(stored[:whole], np.uint8).reshape(item_bytes, -1).T.tobytes() + stored[whole:]
