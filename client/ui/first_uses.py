"""Has libraries import what they import at their first use, for which whoever opens the page would wait.

Import this while there is something else to wait for.
"""

from __future__ import annotations

import uvicorn
from nicegui import ui
from PIL import Image as PillowImage
from starlette.types import Receive, Scope, Send

ELEMENTS = (
    *("button", "card", "dialog", "expansion", "html", "icon", "input", "item", "linear_progress", "menu", "select"),
    *("separator", "switch", "toggle", "tooltip", "upload"),
)


async def _nothing(scope: Scope, receive: Receive, send: Send) -> None:
    """An application that is never called."""


for _element in ELEMENTS:
    getattr(ui, _element)
_config = uvicorn.Config(_nothing, log_config=None)
_config.load()
PillowImage.preinit()
