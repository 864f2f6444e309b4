"""What lies in a folder that can be opened: files by their content, the series of a DICOM folder, folders of slices."""

import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from volsplat.mapshade_server.readers.arrays import raw_voxels
from volsplat.mapshade_server.readers.medicine import dicom_file, dicom_series, picture_folder, tiff_folder
from volsplat.mapshade_server.readers.open_volume import format_of, head_of, parts_of
from volsplat.mapshade_server.readers.reading.natural_order import NameOrder, natural_order
from volsplat.mapshade_server.readers.reading.volume_reader import VolumeFormat
from volsplat.mapshade_server.readers.zarr_arrays import zarr_store
from volsplat.protocol.description.volume_name import VolumeName, volume_name
from volsplat.protocol.messages.folder_messages import (
    LONGEST_KIND,
    LONGEST_NAME,
    MOST_ENTRIES,
    FolderEntry,
    FolderListed,
    ListFolder,
)
from volsplat.protocol.text.errors import BadInput

FILES_KEPT, FOLDERS_KEPT = 1 << 16, 4  # that were looked at: who types a name asks for a folder with each letter

SLICES = (tiff_folder.FOLDER_FORMAT, picture_folder.FOLDER_FORMAT)


class _State(NamedTuple):
    """A file as it is: it changes with whatever is written to it, or put in its place."""

    path: Path
    file: int
    size: int
    changed: int  # ns


def listed(request: ListFolder) -> FolderListed:
    """The answer. Raises BadInput for what is no folder and has no parts, or does not lie below the root."""
    if (whole := _with_parts(request)) is not None:
        return _parts(request, whole)
    folder = _below(request.path, request.folder)
    try:
        entries, left_out = _entries(Path(request.path).resolve(), folder, request.words)
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise BadInput(f"{request.folder or folder.name}: cannot be listed ({reason}); check its permissions") from None
    return FolderListed(request.question, entries, left_out)


def _with_parts(request: ListFolder) -> VolumeName | None:
    """The file, or the folder that is one volume, of which parts are asked for. None for any other folder."""
    if "\0" in request.folder:  # which no name has: _below says what it says of all that is not there
        return None
    name = volume_name(str(Path(request.path, request.folder)))
    try:
        top, found = Path(request.path).resolve(), Path(name.place).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):
        return None
    one = found.is_relative_to(top) and (found.is_file() or zarr_store.recognises_folder(found))
    return name._replace(place=str(found)) if one else None


def _parts(request: ListFolder, whole: VolumeName) -> FolderListed:
    words = request.words.casefold()
    told = [one for one in parts_of(str(whole)) if words in f"{one.part} {one.told}".casefold()]
    entries = [
        FolderEntry("", one.part, one.told[:LONGEST_KIND], 0, is_folder=False, is_volume=True)
        for one in told
        if _can_be_told(one.part)
    ]
    return FolderListed(request.question, entries[:MOST_ENTRIES], len(told) - len(entries[:MOST_ENTRIES]))


def _below(root: str, folder: str) -> Path:
    """The folder, links followed. Raises BadInput in the same words whether what lies outside is there or not."""
    try:
        top = Path(root).resolve()
        found = (top / folder).resolve(strict=True)
        if found.is_relative_to(top) and found.is_dir():
            return found
    except (OSError, RuntimeError, ValueError):  # a ring of links, or a name that can be none
        pass
    raise BadInput(f"{folder or root}: is no folder below the one that volumes are opened from; choose another one")


def _entries(root: Path, folder: Path, exactly: str) -> tuple[list[FolderEntry], int]:
    """What has these words in its name, first what is named exactly so: it is told however much there is beside it."""
    words = exactly.casefold()
    folders, files = _sorted(root, folder)
    images, volumes, left_out = list[_State](), list[FolderEntry](), 0
    entries = [_folder(path) for path in folders if words in path.name.casefold()]
    room = MOST_ENTRIES - len(entries[:MOST_ENTRIES])
    for path in files:
        try:
            state = _state(path)
            found = _format(state)
        except OSError:  # not for us to read
            continue
        if found is None:
            continue
        if found in dicom_series.FORMATS:
            images.append(state)
        elif words in path.name.casefold():
            if len(volumes) < room or path.name == exactly:
                volumes.append(_file(state, found))
            else:
                left_out += 1
    whole = [entry for entry in (*_slices(folder), *_series(tuple(images))) if words in entry.kind.casefold()]
    every = sorted([*entries, *whole, *volumes], key=lambda entry: not entry.name or entry.name != exactly)
    return every[:MOST_ENTRIES], left_out + max(len(every) - MOST_ENTRIES, 0)


def _sorted(root: Path, folder: Path) -> tuple[list[Path], list[Path]]:
    """Folders and files that lie below the root, links followed, but for hidden ones; each in natural order."""
    folders, files = list[Path](), list[Path]()
    with os.scandir(folder) as every:
        for one in every:
            path = folder / one.name
            if one.name[0] == "." or not _can_be_told(one.name) or (one.is_symlink() and not _leads_below(root, path)):
                continue
            if one.is_dir():
                folders.append(path)
            elif one.is_file():
                files.append(path)

    def by_name(path: Path) -> NameOrder:
        return natural_order(path.name)

    return sorted(folders, key=by_name), sorted(files, key=by_name)


def _can_be_told(name: str) -> bool:
    """Whether it is text: a file may be named by any bytes."""
    return name.isprintable() and len(name) <= LONGEST_NAME


def _leads_below(root: Path, link: Path) -> bool:
    try:
        return link.resolve(strict=True).is_relative_to(root)
    except (OSError, RuntimeError):  # it leads nowhere, or is a ring of links
        return False


def _state(path: Path) -> _State:
    found = path.stat()
    return _State(path, found.st_ino, found.st_size, found.st_ctime_ns)


def _format(state: _State) -> VolumeFormat | None:
    """Of a file that can be opened as it is, None for any other. Raises OSError."""
    found = _format_by_head(state)
    undescribed = found in raw_voxels.FORMATS and not raw_voxels.describes(state.path, "")
    return None if undescribed else found


@lru_cache(FILES_KEPT)
def _format_by_head(state: _State) -> VolumeFormat | None:
    packed, head = head_of(state.path)
    found = format_of(state.path, head) if head else None
    if found is None and not packed and dicom_file.recognises_old(head):
        return dicom_series.FORMATS[0]
    return None if found is None or (packed and not found.gzip) else found


def _folder(path: Path) -> FolderEntry:
    if zarr_store.recognises_folder(path):
        return FolderEntry(path.name, "", "Zarr", 0, is_folder=True, is_volume=True)
    return FolderEntry(path.name, "", "folder", 0, is_folder=True, is_volume=False)


def _file(state: _State, found: VolumeFormat) -> FolderEntry:
    kind = found.name.partition(" (")[0]
    return FolderEntry(state.path.name, "", kind, state.size, is_folder=found.parts, is_volume=True)


def _slices(folder: Path) -> Iterator[FolderEntry]:
    """The folder itself, if its files are the slices of a volume."""
    for one in SLICES:
        if one.recognises(folder):
            yield FolderEntry("", "", one.name, 0, is_folder=False, is_volume=True)


@lru_cache(FOLDERS_KEPT)
def _series(images: tuple[_State, ...]) -> tuple[FolderEntry, ...]:
    """The volumes that DICOM images make."""
    return tuple(
        FolderEntry("", part, told[:LONGEST_KIND], 0, is_folder=False, is_volume=True)
        for part, told in dicom_series.told_series([image.path for image in images])
    )
