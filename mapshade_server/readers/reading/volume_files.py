"""The files of a volume, as its identity looks at them: on disk, or where a reader fetches them from."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from volsplat.protocol.description.volume import VolumeDescription


class FileState(NamedTuple):
    size: int  # bytes
    changed: str  # when, or which version it is; "" if that is not known


class Span(NamedTuple):
    """Some bytes of a file."""

    offset: int
    length: int


class VolumeFile(Protocol):
    """One file. Both methods raise OSError if it is gone or cannot be read."""

    def state(self) -> FileState: ...

    def read(self, spans: Sequence[Span]) -> list[bytes]:
        """These bytes, fewer if the file ends before."""


@dataclass(frozen=True)
class DiskFile:
    path: Path

    def state(self) -> FileState:
        stat = self.path.stat()
        return FileState(stat.st_size, str(stat.st_mtime_ns))

    def read(self, spans: Sequence[Span]) -> list[bytes]:
        with self.path.open("rb", buffering=0) as file:
            return [os.pread(file.fileno(), span.length, span.offset) for span in spans]


def disk_files(paths: Sequence[Path]) -> tuple[DiskFile, ...]:
    """These files, each once."""
    return tuple(DiskFile(path) for path in dict.fromkeys(paths))


class Opened(Protocol):
    """A volume that has been opened, by a reader or as a packet store."""

    @property
    def description(self) -> VolumeDescription: ...

    @property
    def files(self) -> Sequence[VolumeFile]:
        """The one with the header first. None if they are the named file, or all below a folder but for hidden ones."""


def files_of(opened: Opened, path: Path) -> Sequence[VolumeFile]:
    """The files of a volume that is `opened` by this name, the one with the header first."""
    return opened.files or _files_at(path)


def _files_at(path: Path) -> tuple[DiskFile, ...]:
    return (DiskFile(path),) if not path.is_dir() else tuple(DiskFile(file) for file in _below(path))


def _below(folder: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if name[0] != ".")
        yield from (Path(place, name) for name in sorted(names) if name[0] != ".")
