"""Imports NiceGUI, for whoever imports this first, without the clients that the library of its sockets brings.

Nothing here asks others by HTTP or by sockets, and they take a third of the time until the page is served.
"""

from __future__ import annotations

import sys

_CLIENTS = tuple(name for name in ("aiohttp", "requests", "tornado") if name not in sys.modules)

for _client in _CLIENTS:
    sys.modules[_client] = None  # type: ignore[assignment]  # as if it were not installed: it is optional to that library
try:
    import nicegui as nicegui
finally:
    for _client in _CLIENTS:
        del sys.modules[_client]
