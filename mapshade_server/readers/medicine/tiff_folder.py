"""Folders of TIFF files, one slice in each: in the order of the numbers in their names, never of the names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from volsplat.mapshade_server.readers.medicine.slice_files import slices_in
from volsplat.mapshade_server.readers.medicine.tiff_pages import TiffPage, check_kind
from volsplat.mapshade_server.readers.medicine.tiff_place import stated_place
from volsplat.mapshade_server.readers.medicine.tiff_stack import Chosen, opened_tiff, stack_of
from volsplat.mapshade_server.readers.reading.volume_reader import FolderFormat, OpenedVolume
from volsplat.protocol.description.slice_folders import TIFFS, slice_kind, visible_files
from volsplat.protocol.text.errors import BadInput


def recognises_folder(folder: Path) -> bool:
    """Whether TIFF files are what the folder is for, not a picture beside slices of another kind."""
    return slice_kind(visible_files(folder)) == TIFFS


def open_tiff_folder(folder: Path, part: str) -> OpenedVolume:
    """The reader for the files whose names begin with `part`.

    Raises BadInput if they are of several kinds, if one is missing, and if they do not fit together.
    """
    paths = slices_in(folder, part, TIFFS, "TIFF")
    pages, places = [], []
    for path in paths:
        with opened_tiff(path) as file:
            pages.append(_only_page(folder, path, file))
            if path == paths[0]:
                places.append(stated_place(file, pages[0].packing, None, ""))
    _check_alike(folder, pages)
    return stack_of(folder.resolve(), "folder of TIFF files", pages, places[0], Chosen(range(len(pages)), part))


def _only_page(folder: Path, path: Path, file: Any) -> TiffPage:
    if file.is_ome and len(file.series[0].pages) > 1 and len(file.pages) == 1:
        raise BadInput(f"{folder}: its files are one OME-TIFF set; give one of them, as in {path}")
    if len(file.pages) > 1:
        raise BadInput(f"{path}: has {len(file.pages)} pages among single slices; give this file, or slices alone")
    page = file.pages[0]
    check_kind(path, page)
    return TiffPage(path, 0, tuple(page.dataoffsets), tuple(page.databytecounts), page)


def _check_alike(folder: Path, pages: Sequence[TiffPage]) -> None:
    first = pages[0].packing
    for page in pages[1:]:
        other = page.packing
        if (other.imagewidth, other.imagelength, other.dtype) != (first.imagewidth, first.imagelength, first.dtype):
            raise BadInput(
                f"{folder}: {page.path.name} differs from {pages[0].path.name} in size or type; put one stack alone "
                "into a folder"
            )


FOLDER_FORMAT = FolderFormat("TIFF slices", open_tiff_folder, recognises_folder)
