"""The mark of a running preparation, a file in the store's own folder: whoever sees it shares the disk.

A task that outlives its command, on a machine that was frozen or cut off, finds it gone, and writes nothing more.
"""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from volsplat.protocol.text.errors import BadInput

MARK = "run-"


@dataclass(frozen=True)
class RunMark:
    path: Path

    def check(self) -> None:
        """Raises BadInput where it is not seen."""
        try:
            self.path.open("rb").close()  # network file systems look again at what is opened, not at what is asked for
        except OSError:
            raise BadInput(
                f"the file {self.path}, which `volsplat prepare` has written, is not there; put OUT.zarr where all "
                "machines see it, at the same path"
            ) from None


@contextmanager
def marked(folder: Path) -> Iterator[RunMark]:
    """Marks a run, alone in this folder, for as long as it lasts."""
    for stale in folder.glob(f"{MARK}*"):  # of runs that were killed
        stale.unlink()
    mark = RunMark(folder / f"{MARK}{uuid.uuid4().hex}")
    mark.path.touch(exist_ok=False)
    try:
        yield mark
    finally:
        mark.path.unlink(missing_ok=True)
