"""A file that leads the person's browser to the page, so that its address stands on no command line.

Every user of a machine can read every other's command lines; the file is its owner's alone.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from volsplat.client.ui.doors.leading_page import leading_page

_SNAPS = Path("/snap")


class RedirectFile:
    """One file, from when it is made to `remove`."""

    def __init__(self, url: str) -> None:
        # Browsers that come as snaps see neither the folder for temporary files nor hidden ones.
        folder = Path.home() if _SNAPS.is_dir() and os.access(Path.home(), os.W_OK) else None
        handle, name = tempfile.mkstemp(prefix="volsplat-page-", suffix=".html", dir=folder)  # of mode 0600
        self._path = Path(name)
        with open(handle, "w", encoding="utf-8") as file:
            file.write(leading_page(url))

    @property
    def address(self) -> str:
        """What a browser is given."""
        return self._path.as_uri()

    def remove(self) -> None:
        """Twice does no harm."""
        self._path.unlink(missing_ok=True)
