"""What tells one source volume from another without reading it."""

from collections.abc import Iterator
from pathlib import Path

from volsplat.mapshade_server.packet_store import Source
from volsplat.protocol.volume_name import volume_name


def source_of(volume: str) -> Source:
    """The volume's name without its folder, and the size and last change of its file or of a folder's files.

    Of a URL, and of the data files of a detached header, nothing is known.
    """
    name = volume_name(volume)
    if name.is_url:
        return Source(str(name), 0, 0)
    path = Path(name.place)
    found = [file.stat() for file in _files(path)]
    return Source(
        name=str(name._replace(place=path.name)),
        size=sum(file.st_size for file in found),
        modified=max((file.st_mtime_ns for file in found), default=0),
    )


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from (file for file in path.rglob("*") if file.is_file())
    else:
        yield path
