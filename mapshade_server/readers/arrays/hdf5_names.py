"""Files that an HDF5 file names: by external links, by virtual datasets, and as places of a dataset's values."""

import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.mapshade_server.readers.reading.named_files import are_held, named_file

SAME_FILE = "."
PREFIX = "HDF5_VDS_PREFIX"  # where else HDF5 looks


def files_beside(dataset: Any) -> list[str]:
    """The names of the files that hold its values; none where these lie in its own."""
    virtual = [source.file_name for source in dataset.virtual_sources()] if dataset.is_virtual else []
    return [*virtual, *(name for name, _, _ in dataset.external or ())]


def missing_beside(path: Path, dataset: Any) -> list[str]:
    """Those files of a virtual dataset that are not where HDF5 looks for them, which then gives its fill value instead.

    Names of files without end, numbered by %b, are left to HDF5.
    """
    if not dataset.is_virtual or PREFIX in os.environ:
        return []
    places = (path.parent, path.resolve().parent, Path())
    return [
        name
        for name in dict.fromkeys(files_beside(dataset))
        if name != SAME_FILE
        and "%b" not in name
        and not any((place / one).exists() for place in places for one in (name, Path(name).name))
    ]


def links_out(h5py: ModuleType, group: Any) -> list[tuple[str, Any]]:
    """The external links in a group and its groups, by path."""
    found: list[tuple[str, Any]] = []

    def look(name: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            found.append((name, link))

    group.visititems_links(look)
    return found


def behind(group: Any, name: str, link: Any) -> Any:
    """What an external link of the group leads to, None if that is not there. Raises BadInput if it is no file."""
    beside = Path(group.file.filename).parent / link.filename
    if beside.exists():
        check_is_file(beside)
    return group.get(name)


def lost_links(h5py: ModuleType, group: Any) -> list[str]:
    """External links that lead nowhere, as a line tells them."""
    return [
        f"{name}, which leads to {link.path} of {link.filename}, which is not there"
        for name, link in links_out(h5py, group)
        if behind(group, name, link) is None
    ]


def refuse_outside(h5py: ModuleType, path: Path) -> None:
    """Where this server is held to a folder: raises BadInput if the file, or one that it leads to, names others.

    Raises what h5py raises for a file that it cannot read.
    """
    to_look_at, seen = [path] if are_held() else [], set[Path]()
    while to_look_at:
        one = to_look_at.pop()
        named = [named_file(one, name) for name in _names(h5py, one)]
        seen.add(one)
        to_look_at += [other for other in named if other not in seen and h5py.is_hdf5(other)]


def _names(h5py: ModuleType, path: Path) -> Iterator[str]:
    found: list[str] = []

    def look_at_object(name: str, one: Any) -> None:
        if isinstance(one, h5py.Dataset):
            found.extend(files_beside(one))

    with h5py.File(path, "r", locking="best-effort") as file:
        found.extend(link.filename for _, link in links_out(h5py, file))
        file.visititems(look_at_object)
    yield from (name for name in dict.fromkeys(found) if name != SAME_FILE)
