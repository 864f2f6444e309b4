"""The folder below which a server opens volumes (--data-root), and what clients hear of names that lead elsewhere."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from volsplat.mapshade_server.readers.reading.named_files import hold_names_to
from volsplat.program.confinement import confine_reading
from volsplat.program.temporary_folder import temporary_folder
from volsplat.protocol.description.volume_name import possible_places, volume_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.file_names import path_of


class DataRoot:
    """`path` is resolved. A name is checked for a clear answer; that nothing else is read, the system sees to."""

    def __init__(self, folder: Path) -> None:
        """Raises BadInput where there is no such folder."""
        try:
            self.path = folder.expanduser().resolve(strict=True)
        except (OSError, RuntimeError) as error:
            raise _no_root(folder, error) from error

    def enter(self) -> None:
        """From now on relative names start from it. Raises BadInput where it is no folder, or closed."""
        try:
            os.chdir(self.path)
        except OSError as error:
            raise _no_root(self.path, error) from error

    def check(self, volume: str) -> None:
        """Raises BadInput, in the same words whether there is something or not: for each place that may be meant."""
        if (name := volume_name(volume)).is_far:
            raise BadInput(f"{name.place}: this server reads no URLs, but what lies below its --data-root")
        for place in possible_places(volume):
            if not self._has(path_of(place)):
                raise BadInput(f"{place}: this server reads what lies below its --data-root alone; name that")

    def _has(self, place: str) -> bool:
        """Whether it lies below, be it there or not."""
        try:
            return Path(place).resolve().is_relative_to(self.path)
        except (OSError, RuntimeError, ValueError):  # a ring of links, or a name that can be none
            return False


def _no_root(folder: Path, error: OSError | RuntimeError) -> BadInput:
    reason = error.strerror if isinstance(error, OSError) else str(error).rstrip(".")
    return BadInput(f"--data-root {folder}: {reason}; name a folder of this machine")


@contextmanager
def held_to(folder: Path) -> Iterator[DataRoot]:
    """From now on this process reads volumes below a folder alone. Call it before there are other threads.

    Raises BadInput where there is no such folder, or where the system cannot see to it.
    """
    root = DataRoot(folder)
    with temporary_folder() as scratch:  # what others put into the common one is not read
        tempfile.tempdir = str(scratch)
        confine_reading((root.path, scratch))  # which looks where the program was begun
        root.enter()
        hold_names_to(root.path)
        yield root
