"""Files that an HDF5 file names: by external links, by virtual datasets, and as places of a dataset's values."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from volsplat.mapshade_server.readers.reading.named_files import are_held, named_file


def files_beside(dataset: Any) -> list[str]:
    """The names of the files that hold its values; none where these lie in its own."""
    virtual = [source.file_name for source in dataset.virtual_sources()] if dataset.is_virtual else []
    return [*virtual, *(name for name, _, _ in dataset.external or ())]


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

    def look_at_link(name: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            found.append(link.filename)

    def look_at_object(name: str, one: Any) -> None:
        if isinstance(one, h5py.Dataset):
            found.extend(files_beside(one))

    with h5py.File(path, "r", locking="best-effort") as file:
        file.visititems_links(look_at_link)
        file.visititems(look_at_object)
    yield from (name for name in dict.fromkeys(found) if name != ".")
