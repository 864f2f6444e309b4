"""Who does the work of a preparation: threads of this process, or the machines of a lab (machines.py)."""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from volsplat.mapshade_server.held.sheet_reader import SheetReader, Sheets
from volsplat.mapshade_server.prepare.ahead import ahead
from volsplat.mapshade_server.prepare.level_packing import LevelPacker, StoredBlock
from volsplat.mapshade_server.prepare.scalars import Scalars
from volsplat.mapshade_server.prepare.store_writer import ShardPlace, StoreWriter
from volsplat.mapshade_server.prepare.survey import Found, Surveyor
from volsplat.protocol.description.volume import Box


class Executor(Surveyor, Protocol):
    """Results come in any order."""

    def reached(self, volume: Scalars) -> Scalars:
        """The volume's scalars, as whoever does the work reads them."""
        ...

    def stored_blocks(self, packer: LevelPacker, writer: StoreWriter, blocks: Sequence[Box]) -> Iterator[StoredBlock]:
        """Packs and stores blocks of a level."""
        ...

    def checksums(
        self, writer: StoreWriter, places: Sequence[ShardPlace]
    ) -> Iterator[tuple[ShardPlace, int | None]]: ...


class Threads:
    """Of this process, so many."""

    def __init__(self, count: int) -> None:
        self._count = count

    def reached(self, volume: Scalars) -> Scalars:
        return volume

    def of_sheets(self, find: Callable[[Sheets], Found], reader: SheetReader) -> Iterator[Found]:
        return ahead(find, reader.sheets(reader.geometry.box), self._count)

    def stored_blocks(self, packer: LevelPacker, writer: StoreWriter, blocks: Sequence[Box]) -> Iterator[StoredBlock]:
        """One is stored while the others are packed."""
        for packed in ahead(packer.packed, blocks, self._count - 1):
            stored = packer.stored(packed, writer)
            del packed  # before the next one is made
            yield stored
            del stored

    def checksums(self, writer: StoreWriter, places: Sequence[ShardPlace]) -> Iterator[tuple[ShardPlace, int | None]]:
        return ahead(writer.read_checksum, places, 1)
