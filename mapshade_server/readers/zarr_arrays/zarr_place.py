"""Where Zarr hierarchies are, in folders, zip files or, through fsspec, at URLs, and what goes wrong there."""

import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from volsplat.mapshade_server.readers.reading import extra
from volsplat.mapshade_server.readers.reading.volume_reader import no_room
from volsplat.mapshade_server.readers.zarr_arrays.web_failures import (
    ANSWER_SECONDS,
    CONNECT_SECONDS,
    end_requests,
    reason_and_cure,
)
from volsplat.mapshade_server.readers.zarr_arrays.zarr_codecs import bounded_codecs
from volsplat.mapshade_server.readers.zarr_arrays.zarr_folder import folder_store
from volsplat.protocol.text.errors import BadInput

METADATA = ("zarr.json", ".zgroup", ".zarray", ".zattrs", ".zmetadata")
LIBRARIES = {"http": "aiohttp", "https": "aiohttp", "s3": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "az": "adlfs"}
LARGEST_METADATA = 1 << 26
MOST_ABOVE = 3  # groups between an image, or a packet store, and an array of it


class ZarrPlace(NamedTuple):
    """An opened store. `prefix` is where in it the hierarchy begins."""

    name: str  # the folder, file or URL
    zarr: Any  # the module
    store: Any
    prefix: str = ""
    above: "Callable[[str], ZarrPlace] | None" = None  # opens the places that hold this one, if there may be some
    seen: dict[str, Any] | None = None  # the nodes that were looked at, where each look is a request or several

    @property
    def is_remote(self) -> bool:
        """Whether each look at it is a request, which takes a while."""
        return self.seen is not None

    def node(self, path: str) -> Any:
        """The array or group at `path`, None if there is none."""
        path = path.strip("/")
        if self.seen is None:
            return self._opened(path)
        if path not in self.seen:
            self.seen[path] = self._opened(path)
        return self.seen[path]

    def _opened(self, path: str) -> Any:
        try:
            with bounded_codecs():
                return self.zarr.open(store=self.store, path=f"{self.prefix}{path}".strip("/"), mode="r")
        except (FileNotFoundError, KeyError):
            return None

    def is_array(self, node: Any) -> bool:
        return isinstance(node, self.zarr.Array)

    def around(self) -> "Iterator[tuple[ZarrPlace, str]]":
        """The places that hold this one, from the inside out, and the path from each of them.

        What is there need not be Zarr, nor be open to this person: opening it, and looking, may raise anything.
        """
        if self.above is None:
            return
        name, path = self.name, ""
        for _ in range(MOST_ABOVE):
            name, _, last = name.rpartition("/")
            if not name or name.endswith("/"):
                return
            path = f"{last}/{path}".strip("/")
            yield self.above(name), path


def folder(name: str) -> ZarrPlace:
    return ZarrPlace(name, _zarr(), folder_store(name), above=folder)


def zip_file(name: str) -> ZarrPlace:
    """The zip's store; if the hierarchy's folder was zipped as a whole, it begins in that folder."""
    zarr = _zarr()
    with zipfile.ZipFile(name) as archive:
        members = [member for member in archive.infolist() if member.filename.rpartition("/")[2] in METADATA]
    check_sizes(name, members, LARGEST_METADATA)
    roots = sorted((member.filename.rpartition("/")[0] for member in members), key=lambda root: len(Path(root).parts))
    prefix = f"{roots[0]}/" if roots and roots[0] else ""
    return ZarrPlace(name, zarr, zarr.storage.ZipStore(name, mode="r"), prefix)


def remote(name: str) -> ZarrPlace:
    zarr = _zarr()
    scheme = name.partition("://")[0]
    try:
        store = zarr.storage.FsspecStore.from_url(name, storage_options=_options(scheme), read_only=True)
    except ImportError as error:
        library = LIBRARIES.get(scheme)
        cure = f"needs {library}, which is not installed: pip install {library}" if library else str(error)
        raise BadInput(f"{name}: {scheme}:// {cure}") from None
    except ValueError:
        raise BadInput(f"{name}: nothing is known of {scheme}://; http, https, s3 and file are read") from None
    return ZarrPlace(name, zarr, store, above=remote, seen={})


def file_system(name: str) -> Any:
    """What a URL's files are looked at with, beside the store."""
    scheme = name.partition("://")[0]
    return extra.library("fsspec", "Zarr at a URL").filesystem(scheme, **_options(scheme))


def _options(scheme: str) -> dict[str, Any]:
    if LIBRARIES.get(scheme) != "aiohttp":
        return {}
    timeout = extra.library("aiohttp", "Zarr over http").ClientTimeout(
        total=None, sock_connect=CONNECT_SECONDS, sock_read=ANSWER_SECONDS
    )
    return {"client_kwargs": {"timeout": timeout}}


def _zarr() -> Any:
    return extra.library("zarr", "Zarr")


def check_sizes(name: str, members: list[zipfile.ZipInfo], most: int) -> None:
    """Raises BadInput if a member of a zip file would become larger than what it is for."""
    for member in members:
        if member.file_size > max(most, LARGEST_METADATA):
            raise BadInput(
                f"{name}: {member.filename} would unpack to {member.file_size} bytes, too many for what it is; "
                "the file is damaged or made to do harm"
            )


@contextmanager
def one_line_errors(name: str) -> Iterator[None]:
    """Turns what zarr, its codecs and file systems raise, which is anything, into BadInput."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of what is beside arrays, of types that zarr may change
            yield
    except BadInput:
        raise
    except MemoryError:
        raise no_room(name) from None
    except Exception as error:
        if "://" in name:
            end_requests()
        raise BadInput(f"{name}: {reason_and_cure(error)}") from None
