"""Which beginnings of a part with options are paths of a Zarr hierarchy, by few requests where each is paid for."""

import errno
from contextlib import suppress
from functools import cached_property
from typing import Any

from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.zarr_arrays.zarr_place import ZarrPlace

MOST_REQUESTS = 1  # of paths that may be there, as a rule none is
NO_PATH = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EINVAL, errno.EILSEQ, errno.ELOOP)


class ZarrPaths:
    """What `place` has. At a URL no more is asked than MOST_REQUESTS, unless `thorough`; `left_out` tells of more."""

    def __init__(self, place: ZarrPlace, thorough: bool = False) -> None:
        self._place = place
        self._thorough = thorough or not place.is_remote
        self._asked = 0
        self.left_out = False

    def has(self, path: str) -> bool:
        """Whether an array or group is there, or may have a level of that number. False for what can be no path."""
        if "\0" in path or not {".", ".."}.isdisjoint(path.split("/")):
            return False
        path = "/".join(filter(None, path.split("/")))
        group, _, number = path.rpartition("/")
        if self._thorough:
            return self._is_there(path) or (number.isdecimal() and self._is_there(group))
        wanted = group if number.isdecimal() else path
        if self._known is not None:
            return not {path, wanted}.isdisjoint(self._known)
        if self._asked >= MOST_REQUESTS:
            self.left_out = True
            return False
        self._asked += 1
        return self._answers(wanted, is_group=wanted != path)

    def _is_there(self, path: str) -> bool:
        try:
            return self._place.node(path) is not None
        except OSError as error:
            if error.errno in NO_PATH:
                return False
            raise

    @cached_property
    def _known(self) -> set[str] | None:
        """All paths, if the hierarchy tells them by itself: an array has none. None where they are not known."""
        root: Any = self._place.node("")
        if self._place.is_array(root):
            return {""}
        consolidated = None if root is None else root.metadata.consolidated_metadata
        return None if consolidated is None else {"", *consolidated.flattened_metadata}

    def _answers(self, path: str, is_group: bool) -> bool:
        """By one request, and no failure: what is there will be opened, and says then what is wrong."""
        root = self._place.node("")
        version = 3 if root is None else root.metadata.zarr_format
        document = "zarr.json" if version == 3 else ".zgroup" if is_group else ".zarray"
        with suppress(Exception):
            key = f"{self._place.prefix}{path}/{document}".lstrip("/")
            return bool(library("zarr.core.sync", "Zarr").sync(self._place.store.exists(key)))
        return False
