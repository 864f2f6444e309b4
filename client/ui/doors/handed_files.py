"""Files that a tab's browser saves: it is given an address for each, and fetches it from there.

Sent by the page's own socket, a file would hold up all else that is said there; a slow line would be taken for cut
before it is through, and be given it anew for ever.
"""

from __future__ import annotations

import asyncio
import secrets
import shutil
from collections import deque
from pathlib import Path
from weakref import WeakKeyDictionary, finalize

from nicegui import Client, context, ui
from starlette.responses import FileResponse, PlainTextResponse, Response

from volsplat.program.temporary_folder import made_folder, no_temporary

FILES_PATH = "/volsplat/files"
KEPT = 4  # of a tab, so that the browser may go on with one whose line was cut

_KEY_BYTES = 16
_GONE = "volsplat: this file is kept no longer; save it from the page once more\n"
_UNCODED = {"Content-Encoding": "identity"}  # pictures and movies are compressed already


class _Handed:
    """A file in a folder that is its own; the folder ends with this, and with the process."""

    def __init__(self, path: Path) -> None:
        self.key = secrets.token_urlsafe(_KEY_BYTES)
        self.path = path
        finalize(self, shutil.rmtree, path.parent, ignore_errors=True)


_handed: WeakKeyDictionary[Client, deque[_Handed]] = WeakKeyDictionary()


def hand_file(path: Path) -> None:
    """Have the browser of this tab save the file. The folder around it, which holds nothing else, ends with it."""
    client = context.client
    if client not in _handed:
        _handed[client] = deque(maxlen=KEPT)
        client.on_delete(lambda: _handed.pop(client, None))
    handed = _Handed(path)
    _handed[client].append(handed)
    ui.download.from_url(f"{FILES_PATH}/{handed.key}", path.name)


async def hand_bytes(data: bytes, name: str) -> None:
    """Likewise of what is to be in a file of that name. Raises BadInput if there is no room for it."""
    hand_file(await asyncio.to_thread(_written, data, name))


def _written(data: bytes, name: str) -> Path:
    path = made_folder() / name
    try:
        path.write_bytes(data)
    except OSError as error:
        shutil.rmtree(path.parent, ignore_errors=True)
        raise no_temporary("file", error) from error
    return path


async def handed_file(key: str) -> Response:
    """The answer to a browser that fetches it, as often as it likes for as long as it is kept."""
    handed = next((one for of_tab in list(_handed.values()) for one in of_tab if one.key == key), None)
    if handed is None:
        return PlainTextResponse(_GONE, 404)
    return _FileAnswer(handed)


class _FileAnswer(FileResponse):
    """Keeps the file for as long as it is sent."""

    def __init__(self, handed: _Handed) -> None:
        super().__init__(handed.path, headers=_UNCODED, filename=handed.path.name)
        self._handed = handed
