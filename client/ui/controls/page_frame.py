"""What every page of the program has: its styles, its title, events that are kept, and the button for light or dark."""

from __future__ import annotations

from nicegui import ui

from volsplat.client.ui.controls.kept_events import KeptEvents
from volsplat.client.ui.doors.static_files import frame_styles


def page_frame(title: str) -> None:
    """Add what no eye sees, and name the page."""
    ui.add_head_html(f"<style>{frame_styles()}</style>")
    ui.page_title(f"{title} – volsplat")
    ui.add_head_html('<script>document.documentElement.lang = "en";</script>')
    KeptEvents()


def theme_button() -> None:
    """Between light and dark."""
    # NiceGUI's own element for this sets the theme at each rendering of the page, which styles all of it anew.
    button = ui.button(icon="contrast").props("flat dense round aria-label='light or dark'")
    button.tooltip("light or dark")
    button.on("click", js_handler="() => Quasar.Dark.toggle()")
