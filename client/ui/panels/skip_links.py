"""The first thing that Tab reaches: ways to each part of the page, seen while one of them has the focus."""

from __future__ import annotations

import json

from nicegui import ui

PARTS = {
    "picture": ".vs-picture",
    "shading": '[aria-label="shading"]',
    "view": '[aria-label="view"]',
    "bounds": '[aria-label="bounds"]',
    "refinement": '[aria-label="refinement"]',
    "image": '[aria-label="image"]',
    "tables": '[aria-label="tables"]',
    "servers": ".vs-servers",
}
"""What each part is called, and where it is."""

_TAKES_FOCUS = ':is(a, button, input, canvas, [tabindex="0"]):not(:disabled, [tabindex="-1"])'


def skip_links() -> None:
    """A button for each part, which gives the focus to the first thing there that takes it.

    A drawer opens for it (static/controls/drawers.js).
    """
    with ui.element("nav").classes("vs-skip").props('aria-label="parts of the page"'):
        for part, place in PARTS.items():
            first = json.dumps(f"{place}{_TAKES_FOCUS}, {place} {_TAKES_FOCUS}")
            button = ui.button(f"to the {part}", color=None).props("flat dense no-caps")
            wanted = 'first.closest("aside")?.dispatchEvent(new Event("vs-wanted"))'
            found = f"const first = document.querySelector({first})"
            button.on("click", js_handler=f"() => {{ {found}; {wanted}; first.focus(); }}")
