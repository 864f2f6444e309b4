"""What every page of the program has: its styles, its title, events that are kept, and the button for light or dark."""

from __future__ import annotations

from functools import cache

from nicegui import ui

from volsplat.client.ui.controls.kept_events import KeptEvents
from volsplat.client.ui.doors.static_files import STATIC

STYLES = ("theme.css", "page.css")


def page_frame(title: str) -> None:
    """Add what no eye sees, and name the page."""
    for style in STYLES:
        ui.add_head_html(f"<style>{_text(style)}</style>")
    ui.page_title(f"{title} – volsplat")
    ui.add_head_html('<script>document.documentElement.lang = "en";</script>')
    KeptEvents()


@cache
def _text(style: str) -> str:
    return (STATIC / style).read_text("utf-8")


def theme_button() -> None:
    """Between light and dark."""
    # NiceGUI's own element for this sets the theme at each rendering of the page, which styles all of it anew.
    button = ui.button(icon="contrast").props("flat dense round aria-label='light or dark'")
    button.tooltip("light or dark")
    button.on("click", js_handler="() => Quasar.Dark.toggle()")
