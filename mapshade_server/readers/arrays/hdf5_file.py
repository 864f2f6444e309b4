"""HDF5's library, and files opened by it, locked against writers where the file system can."""

from pathlib import Path
from types import ModuleType
from typing import Any

from volsplat.mapshade_server.readers.reading.extra import library


def h5py() -> ModuleType:
    """Raises BadInput with the extra that is missing."""
    return library("h5py", "HDF5")


def hdf5_file(path: Path) -> Any:
    """To be closed, as by `with`. Raises what h5py raises, and BadInput without it."""
    return h5py().File(path, "r", locking="best-effort")
