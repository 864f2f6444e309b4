"""Folders of TIFF files, one slice in each: in the order of the numbers in their names, never of the names."""

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from volsplat.mapshade_server.readers.medicine.tiff_pages import TiffPage, tifffile
from volsplat.mapshade_server.readers.medicine.tiff_stack import (
    Chosen,
    TiffStackReader,
    check_ends,
    stack_of,
    stated_place,
)
from volsplat.mapshade_server.readers.simple_itk import refuse_vectors
from volsplat.protocol.errors import BadInput

EXTENSIONS = (".tif", ".tiff")
MOST_SHOWN = 6


def recognises_folder(folder: Path) -> bool:
    """Whether TIFF files are what the folder is for, not a picture beside slices of another kind."""
    names = [path.name for path in _visible(folder)]
    return 0 < len(names) <= 2 * sum(name.lower().endswith(EXTENSIONS) for name in names)


def _visible(folder: Path) -> list[Path]:
    """The files but for hidden ones, as some systems leave them beside others."""
    return [path for path in folder.iterdir() if path.name[0] != "." and path.is_file()]


def open_tiff_folder(folder: Path, part: str) -> TiffStackReader:
    """The reader for the files whose names begin with `part`.

    Raises BadInput where they are of several kinds, where one is missing, and where they do not fit together.
    """
    paths = _in_order(folder, part, [path for path in _visible(folder) if path.name.lower().endswith(EXTENSIONS)])
    pages, places = [], []
    for path in paths:
        try:
            with tifffile().TiffFile(path) as file:
                pages.append(_only_page(folder, path, file))
                if path == paths[0]:
                    places.append(stated_place(file, pages[0].packing, None, ""))
        except (BadInput, OSError):
            raise
        except Exception as error:  # of a damaged file's tags tifffile makes anything
            raise BadInput(f"{path}: is truncated or damaged ({error}); fetch or export it again") from None
    _check_alike(folder, pages)
    return stack_of(folder.resolve(), "folder of TIFF files", pages, places[0], Chosen(range(len(pages)), part))


def _in_order(folder: Path, part: str, paths: Sequence[Path]) -> list[Path]:
    """The files of one kind by their number. Raises BadInput where that is not told or a number is missing."""
    kinds: dict[str, list[Path]] = defaultdict(list)
    for path in paths:
        if path.name.startswith(part):
            kinds[re.sub(r"\d+", "#", path.name)].append(path)
    if not kinds:
        raise BadInput(f"{folder}: no TIFF file's name begins with “{part}”; there are {_shown(paths)}")
    if len(kinds) > 1:
        told = ", ".join(f"{len(files)} {kind}" for kind, files in list(kinds.items())[:MOST_SHOWN])
        raise BadInput(
            f"{folder}: holds TIFF files of several kinds ({told}); choose by how the names begin, "
            f"as in {folder}#{_beginning(next(iter(kinds.values())))}"
        )
    files = next(iter(kinds.values()))
    numbers = {path: [int(number) for number in re.findall(r"\d+", path.name)] for path in files}
    counting = [n for n, values in enumerate(zip(*numbers.values(), strict=True)) if len(set(values)) > 1]
    if len(counting) > 1:
        first = min(files, key=lambda path: numbers[path])
        raise BadInput(
            f"{folder}: the names count by {len(counting)} numbers, as in {first.name}; choose by how the names begin, "
            f"as in {folder}#{_before_number(first.name, counting[-1])}"
        )
    if not counting:
        return list(files)
    by_number = sorted((numbers[path][counting[0]], path) for path in files)
    _check_complete(folder, [number for number, _ in by_number])
    return [path for _, path in by_number]


def _beginning(files: Sequence[Path]) -> str:
    """How names of one kind begin, before their first number."""
    return re.split(r"\d", files[0].name)[0] or files[0].name


def _before_number(name: str, which: int) -> str:
    return name[: [match.start() for match in re.finditer(r"\d+", name)][which]]


def _check_complete(folder: Path, numbers: Sequence[int]) -> None:
    gaps = [after - before for before, after in zip(numbers, numbers[1:], strict=False)]
    usual = min(gaps)
    if usual == 0:
        raise BadInput(f"{folder}: two files bear the number {numbers[gaps.index(0)]}; put one stack into a folder")
    for number, gap in zip(numbers, gaps, strict=False):
        if gap != usual:
            raise BadInput(
                f"{folder}: slices are missing: after number {number} comes {number + gap}, elsewhere the numbers "
                f"grow by {usual}; complete the folder, or number its files without a gap"
            )


def _shown(paths: Sequence[Path]) -> str:
    names = sorted(path.name for path in paths)
    return ", ".join(names[:MOST_SHOWN]) + (", …" if len(names) > MOST_SHOWN else "")


def _only_page(folder: Path, path: Path, file: Any) -> TiffPage:
    check_ends(path, file)
    if file.is_ome and len(file.series[0].pages) > 1 and len(file.pages) == 1:
        raise BadInput(f"{folder}: its files are one OME-TIFF set; give one of them, as in {path}")
    if len(file.pages) > 1:
        raise BadInput(f"{path}: has {len(file.pages)} pages among single slices; give this file, or slices alone")
    page = file.pages[0]
    if page.samplesperpixel != 1:
        refuse_vectors(path, f"{page.samplesperpixel} samples a pixel")
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
