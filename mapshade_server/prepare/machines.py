"""The machines of a lab, which share the work of a preparation through a task pool and a disk that all see.

They read, pack and write shards, each a file of its own; the command's own process alone keeps the journal and writes
the files that blocks share. Whatever is done twice, because a machine was lost or is late, has the same bytes.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.sheet_reader import SheetReader, Sheets
from volsplat.mapshade_server.prepare.level_packing import LevelPacker, StoredBlock
from volsplat.mapshade_server.prepare.progress import Progress
from volsplat.mapshade_server.prepare.run_mark import RunMark
from volsplat.mapshade_server.prepare.scalars import Scalars
from volsplat.mapshade_server.prepare.shared_volume import SharedVolume, shared_scalars
from volsplat.mapshade_server.prepare.store_writer import ShardPlace, StoreWriter
from volsplat.mapshade_server.prepare.survey import Found
from volsplat.program.task_pool import TaskPool
from volsplat.protocol.description.volume import SCALAR_BYTES, Box

READINGS_IN_A_TASK = 8  # of which all but the first take their halo from the one before


class Machines:
    def __init__(self, pool: TaskPool, mark: RunMark, volume: SharedVolume, progress: Progress) -> None:
        self._pool = pool
        self._mark = mark
        self._volume = volume
        self._progress = progress

    def check(self, reads_volume: bool) -> None:
        """Raises BadInput if one of those that are there does not share the disk, or has no such volume."""
        self._pool.on_each(
            partial(check_process, self._mark, self._volume if reads_volume else None), self._progress.check_wanted
        )

    def reached(self, volume: Scalars) -> Scalars:
        return shared_scalars(self._volume, volume)

    def of_sheets(self, find: Callable[[Sheets], Found], reader: SheetReader) -> Iterator[Found]:
        for found in self._pool.results(
            partial(_of_part, find, reader), list(_parts(reader)), self._progress.check_wanted
        ):
            yield from found

    def stored_blocks(self, packer: LevelPacker, writer: StoreWriter, blocks: Sequence[Box]) -> Iterator[StoredBlock]:
        return self._pool.results(partial(_stored, packer, writer, self._mark), blocks, self._progress.check_wanted)

    def checksums(self, writer: StoreWriter, places: Sequence[ShardPlace]) -> Iterator[tuple[ShardPlace, int | None]]:
        return self._pool.results(writer.read_checksum, places, self._progress.check_wanted)


def check_process(mark: RunMark, volume: SharedVolume | None) -> None:
    """Raises BadInput if this process does not share the disk, or has no such volume."""
    mark.check()
    if volume is not None:
        volume.scalars()


def _of_part(find: Callable[[Sheets], Found], reader: SheetReader, part: Box) -> list[Found]:
    return [find(sheets) for sheets in reader.sheets(part)]


def _stored(packer: LevelPacker, writer: StoreWriter, mark: RunMark, block: Box) -> StoredBlock:
    _kernels.give_freed_memory_back()  # as the command's own process does
    packed = packer.packed(block)
    mark.check()
    return packer.stored(packed, writer)


def _parts(reader: SheetReader) -> Iterator[Box]:
    """Whole sheets, and whole chunks of them, for a task each."""
    ni, nj, nk = reader.geometry.dims
    chunk = reader.chunk[2]
    bytes_in_a_task = READINGS_IN_A_TASK * reader.bytes_at_once
    sheets = max(1, bytes_in_a_task // (ni * nj * SCALAR_BYTES[reader.scalar_type] * chunk)) * chunk
    for k in range(0, nk, sheets):
        yield Box((0, 0, k), (ni, nj, min(k + sheets, nk)))
