"""Zarr's own store of a folder, which opens nothing but files: a FIFO among them would be waited for without an end."""

from pathlib import Path
from typing import Any

from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.mapshade_server.readers.zarr_arrays.web_failures import drop_left_over

PACKET_STORE = "volsplat"  # the attribute of the group that `volsplat prepare` makes


def folder_store(folder: str) -> Any:
    """The store to read from. What is asked of it raises BadInput if that is a FIFO, a device or a lost link."""
    drop_left_over()  # of the reads that were under way when one was refused
    local: Any = library("zarr", f"{folder}: Zarr").storage.LocalStore

    class FolderStore(local):  # type: ignore[misc]
        async def get(self, key: str, *arguments: Any, **named: Any) -> Any:
            self._check(key)
            return await super().get(key, *arguments, **named)

        def get_sync(self, key: str, **named: Any) -> Any:
            self._check(key)
            return super().get_sync(key, **named)

        async def get_partial_values(self, prototype: Any, key_ranges: Any) -> Any:
            wanted = list(key_ranges)
            for key, _ in wanted:
                self._check(key)
            return await super().get_partial_values(prototype, wanted)

        def _check(self, key: str) -> None:
            path = Path(folder, key)
            if path.exists() or path.is_symlink():  # a missing chunk is a fill value, a lost one is not
                check_is_file(path)

    return FolderStore(folder, read_only=True)
