"""What a hand does with the panels comes to the process once, wherever a line is cut, and what waits for it stays."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

from nicegui import Client, core
from nicegui.element import Element

from volsplat.client.ui.doors.static_files import MODULES


class KeptEvents(Element, component="kept_events_component.js", esm=MODULES):
    """Has the page of one tab number its events, and repeat those that are not answered (see kept_events.js)."""


def take_events_once() -> None:
    """Have NiceGUI pass over an event that a page repeats though it came: only its answer was lost."""
    newest: WeakKeyDictionary[Client, int] = WeakKeyDictionary()

    def take(_socket: str, event: dict[str, Any]) -> None:
        client = Client.instances.get(event["client_id"])
        if client is None or not client.has_socket_connection:
            return
        number = event.get("number")  # none before the page has its scripts
        if number is not None:
            if number <= newest.get(client, 0):
                return
            newest[client] = number
        client.handle_event(event)

    core.sio.on("event", take)
