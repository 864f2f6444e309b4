"""Slices in files of their own: in the order of the numbers in their names, never of the names."""

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.protocol.description.slice_folders import visible_files
from volsplat.protocol.text.errors import BadInput

MOST_SHOWN = 6


def slices_in(folder: Path, begin: str, extensions: tuple[str, ...], what: str) -> list[Path]:
    """The files with these extensions whose names begin so, by their number; `what` is what they are called.

    Raises BadInput if they are of several kinds, if one is missing and if one is no file.
    """
    paths = [folder / name for name in visible_files(folder) if name.lower().endswith(extensions)]
    for path in paths:
        check_is_file(path)
    return _in_order(folder, begin, paths, what)


def _in_order(folder: Path, part: str, paths: Sequence[Path], what: str) -> list[Path]:
    """The files of one kind by their number. Raises BadInput if that is not clear or a number is missing."""
    kinds: dict[str, list[Path]] = defaultdict(list)
    for path in paths:
        if path.name.startswith(part):
            kinds[re.sub(r"\d+", "#", path.name)].append(path)
    if not kinds:
        raise BadInput(f"{folder}: no {what} file's name begins with “{part}”; there are {_shown(paths)}")
    if len(kinds) > 1:
        told = ", ".join(f"{len(files)} {kind}" for kind, files in list(kinds.items())[:MOST_SHOWN])
        raise BadInput(
            f"{folder}: holds {what} files of several kinds ({told}); choose by how the names begin, "
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
