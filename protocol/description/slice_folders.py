"""Folders whose files are slices: what whoever opens such a folder, and whoever writes into one, must know alike."""

import os
from collections.abc import Collection
from pathlib import Path

TIFFS = (".tif", ".tiff")
PICTURES = (".png", ".jpg", ".jpeg", ".bmp")


def visible_files(folder: Path) -> list[str]:
    """The files' names but for hidden ones, as some systems leave them beside others. Asks for few one by one."""
    with os.scandir(folder) as every:
        return [one.name for one in every if one.name[0] != "." and _is_file(one)]


def _is_file(one: "os.DirEntry[str]") -> bool:
    """Links are followed; a FIFO and a link that leads nowhere are files, too, for whoever opens them to refuse."""
    return one.is_file(follow_symlinks=False) or not os.path.isdir(one)


def slice_kind(names: Collection[str]) -> tuple[str, ...]:
    """How the names of the slices end if such files are what a folder is for, not a picture beside others; else ()."""
    return next((kind for kind in (TIFFS, PICTURES) if 0 < len(names) <= 2 * _count(names, kind)), ())


def _count(names: Collection[str], kind: tuple[str, ...]) -> int:
    return sum(name.lower().endswith(kind) for name in names)
