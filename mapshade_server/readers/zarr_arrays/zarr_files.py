"""What distinguishes one Zarr hierarchy from another: documents that describe an array, and some of its chunks."""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from volsplat.mapshade_server.readers.reading.volume_files import DiskFile, FileState, Span, VolumeFile
from volsplat.mapshade_server.readers.zarr_arrays.zarr_place import METADATA

CHUNKS_ON_DISK = 64  # that are looked at
CHUNKS_AT_URL = 8  # likewise, each by a request
DOCUMENTS = {3: ("zarr.json",), 2: (".zgroup", ".zarray", ".zattrs")}  # by the format's version
VERSIONS = ("ETag", "etag", "LastModified", "last_modified", "Last-Modified", "mtime")  # as file systems call them
NO_CHANGE = ""


@dataclass(frozen=True)
class FetchedFile:
    """What was found at a URL; of a chunk not the bytes, only which version it is."""

    found: FileState
    beginning: bytes

    def state(self) -> FileState:
        return self.found

    def read(self, spans: Sequence[Span]) -> list[bytes]:
        return [self.beginning[span.offset : span.offset + span.length] for span in spans]


def files_of_arrays(folder: Path, arrays: Sequence[Any]) -> tuple[VolumeFile, ...]:
    """Documents and chunks of arrays below a folder, as far as they are there: chunks without data need not be."""
    documents = dict.fromkeys(name for array in arrays for name in _documents(array, METADATA))
    chunks = [name for array in arrays for name in _chunks(array, max(CHUNKS_ON_DISK // len(arrays), 1))]
    return tuple(DiskFile(folder / name) for name in (*documents, *chunks) if (folder / name).is_file())


def fetched_files(url: str, array: Any, file_system: Callable[[], Any]) -> tuple[VolumeFile, ...]:
    """Documents and chunks of an array at a URL, asked for side by side. Raises OSError if it does not answer."""
    files = file_system()
    documents = list(_documents(array, DOCUMENTS[array.metadata.zarr_format]))

    def fetched(name: str) -> FetchedFile | None:
        try:
            found = files.info(f"{url}/{name}")
            beginning = files.cat_file(f"{url}/{name}") if name in documents else b""
        except FileNotFoundError:
            return None
        changed = next((str(found[key]) for key in VERSIONS if found.get(key)), NO_CHANGE)
        return FetchedFile(FileState(found.get("size") or len(beginning), changed), beginning)

    with ThreadPoolExecutor(CHUNKS_AT_URL, "look at files") as asking:
        answers = list(asking.map(fetched, [*documents, *_chunks(array, CHUNKS_AT_URL)]))
    return tuple(answer for answer in answers if answer is not None)


def _documents(array: Any, names: Sequence[str]) -> Iterator[str]:
    """Those of the array and of all groups that hold it."""
    words = array.path.split("/") if array.path else []
    for depth in range(len(words), -1, -1):
        yield from ("/".join([*words[:depth], name]) for name in names)


def _chunks(array: Any, most: int) -> Iterator[str]:
    """The names of so many chunks, or shards, that lie evenly in the array."""
    sizes = array.shards or array.chunks
    counts = [math.ceil(length / size) for length, size in zip(array.shape, sizes, strict=True)]
    total = math.prod(counts)
    wanted = range(total) if total <= most else [n * (total - 1) // max(most - 1, 1) for n in range(most)]
    strides = [math.prod(counts[axis + 1 :]) for axis in range(len(counts))]
    for n in dict.fromkeys(wanted):
        place = tuple(n // stride % count for stride, count in zip(strides, counts, strict=True))
        yield "/".join(filter(None, (array.path, array.metadata.encode_chunk_key(place))))
