"""Files that an HDF5 file names: by external links, by virtual datasets, and as places of a dataset's values."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

from volsplat.mapshade_server.readers.arrays.hdf5_file import h5py, hdf5_file
from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.mapshade_server.readers.reading.named_files import are_held, named_file

SAME_FILE = "."
MOST_OBJECTS = 20000  # of a file that are looked at for datasets, and links for files
MOST_HOPS = 16  # from link to link, as HDF5 has it


def files_beside(dataset: Any) -> list[str]:
    """The names of the files that hold its values, each once; none where these lie in its own."""
    virtual = list[str]()
    if dataset.is_virtual:  # which writes a percent sign twice
        told = dataset.id.get_create_plist()
        virtual = [told.get_virtual_filename(n).replace("%%", "%") for n in range(told.get_virtual_count())]
    return list(dict.fromkeys([*virtual, *(name for name, _, _ in dataset.external or ())]))


def is_numbered(name: str) -> bool:
    """Whether a virtual dataset writes one name so for many."""
    return "%b" in name.replace("%%", "")


def check_files_beside(dataset: Any) -> None:
    """Raises BadInput if a file that holds its voxels is a FIFO, which HDF5 would wait for."""
    for name in files_beside(dataset):
        if (place := found_beside(Path(dataset.file.filename), name)) is not None:
            check_is_file(place)


def found_beside(own: Path, name: str) -> Path | None:
    """The file that another one names, where HDF5 finds it; held to a folder, only where it may look."""
    given = Path(name)
    places = [own.parent / given]  # absolute ones as they are
    if not are_held():
        places += [own.parent / given.name if given.is_absolute() else given, own.resolve().parent / given]
    return next((place for place in places if place.exists()), None)


def links_out(group: Any, most: int) -> list[tuple[str, Any]]:
    """The external links in a group and its groups, by path, among so many links of all kinds."""
    return [(path, group.get(path, getlink=True)) for path in _links(group, most, h5py().h5l.TYPE_EXTERNAL)]


def soft_links(group: Any, most: int) -> list[str]:
    """The paths of the soft ones, likewise."""
    return _links(group, most, h5py().h5l.TYPE_SOFT)


def _links(group: Any, most: int, kind: int) -> list[str]:
    found: list[str] = []
    left = most

    def look(name: bytes, info: Any) -> bool | None:
        nonlocal left
        left -= 1
        if info.type == kind:
            found.append(name.decode(errors="surrogateescape"))
        return True if left <= 0 else None

    group.id.links.visit(look, info=True)
    return found


class FilesByLinks:
    """Files that external links lead to, for a block in which many are followed.

    Some stay open until its end: to close one, h5py goes through all that is open of any.
    """

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._open: dict[Path, Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def opened(self, place: Path) -> Any:
        """Raises OSError for one that is cut short."""
        if place not in self._open:
            if len(self._open) == MOST_HOPS:
                self._stack.close()
                self._open.clear()
            self._open[place] = self._stack.enter_context(hdf5_file(place))
        return self._open[place]


def check_way(group: Any, path: str, files: FilesByLinks | None = None, hops: int = MOST_HOPS) -> list[Path]:
    """The files that external links on the way to a path lead to, which may be among `files`.

    Raises BadInput if one leads to what is no file: HDF5 would wait for a FIFO.
    """
    if files is None:
        with FilesByLinks() as files:
            return check_way(group, path, files, hops)
    at, steps = (
        group.file if path.startswith("/") else group,
        [step for step in path.split("/") if step not in ("", ".")],
    )
    for n, step in enumerate(steps):
        link, rest = at.get(step, getlink=True), "/".join(steps[n + 1 :])
        if isinstance(link, h5py().ExternalLink):
            return _check_way_out(at, link, rest, files, hops)
        if isinstance(link, h5py().SoftLink) and hops:
            return check_way(at, f"{link.path}/{rest}", files, hops - 1)
        if not (isinstance(link, h5py().HardLink) and isinstance(at[step], h5py().Group)):
            break
        at = at[step]
    return []


def _check_way_out(group: Any, link: Any, rest: str, files: FilesByLinks, hops: int) -> list[Path]:
    if (place := found_beside(Path(group.file.filename), link.filename)) is None:
        return []
    check_is_file(place)
    passed = [place]
    if hops and h5py().is_hdf5(place):
        with suppress(OSError):  # cut short, it leads nowhere
            passed += check_way(files.opened(place), f"{link.path}/{rest}", files, hops - 1)
    return passed


def behind(group: Any, name: str, files: FilesByLinks | None = None) -> Any:
    """What a link of the group leads to, None if that is not there. Raises BadInput if it is no file."""
    check_way(group, name, files)
    with suppress(RuntimeError):  # links that lead round in a circle
        return group.get(name)
    return None


def lost_links(group: Any) -> list[str]:
    """External links that lead nowhere, as a line tells them."""
    with FilesByLinks() as files:
        return [
            f"{name}, which leads to {link.path} of {link.filename}, which is not there"
            for name, link in links_out(group, MOST_OBJECTS)
            if behind(group, name, files) is None
        ]


def refuse_outside(path: Path) -> None:
    """Where this server is held to a folder: raises BadInput if the file, or one that it leads to, names others.

    Raises what h5py raises for a file that it cannot read.
    """
    to_look_at, seen = [path] if are_held() else [], set[Path]()
    while to_look_at:
        one = to_look_at.pop()
        named = [named_file(one, name) for name in _names(one)]
        seen.add(one)
        to_look_at += [other for other in named if other not in seen and h5py().is_hdf5(other)]


def _names(path: Path) -> Iterator[str]:
    found: list[str] = []

    def look_at_object(name: str, one: Any) -> None:
        if isinstance(one, h5py().Dataset):
            found.extend(files_beside(one))

    with hdf5_file(path) as file:
        found.extend(link.filename for _, link in links_out(file, sys.maxsize))
        file.visititems(look_at_object)
    yield from (name for name in dict.fromkeys(found) if name != SAME_FILE)
