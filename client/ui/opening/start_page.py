"""The page before there is a volume: what can be opened."""

from __future__ import annotations

from nicegui import context, ui

from volsplat.client.ui.controls.page_frame import page_frame, theme_button
from volsplat.client.ui.opening.dropped_files import DroppedFiles
from volsplat.client.ui.opening.opening import Opening
from volsplat.client.ui.opening.shown_volume import ShownVolume
from volsplat.client.ui.opening.volume_chooser import VolumeChooser


def start_page(shown: ShownVolume, opening: Opening) -> None:
    """Build it for one tab, which is loaded anew once a volume is shown."""
    page_frame("open a volume")
    client = context.client

    def load_anew() -> None:
        client.run_javascript("location.reload()")

    client.on_delete(shown.on_first(load_anew))
    with ui.element("div").classes("vs-start"), ui.card().classes("vs-dialog vs-open"):
        with ui.element("div").classes("vs-start-head"):
            ui.label("Open a volume").classes("vs-name").props("role=heading aria-level=1")
            ui.element("div").classes("vs-spread")
            theme_button()
        chooser = VolumeChooser(opening, may_keep_tables=False)
        chooser.show_recent([])
        DroppedFiles(None, chooser.offer)
    ui.timer(0.0, chooser.look, once=True)
