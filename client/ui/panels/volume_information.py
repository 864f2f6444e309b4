"""What is known of the volume, under a button in the page's head: as `volsplat info` tells it, readers' notes first."""

from __future__ import annotations

from nicegui import ui

from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.volume_info import NOTE, info_rows


def volume_information(volume: SurveyedVolume) -> None:
    """A button that shows whether the reader had something to note, and opens a table of all that is known."""
    rows = sorted(info_rows(volume), key=lambda row: row[0] != NOTE)
    notes = sum(name == NOTE for name, _ in rows)
    said = "about this volume" + (f": {notes} note{'' if notes == 1 else 's'} of its reader" if notes else "")
    with ui.button(icon="info", color=None).props("flat dense round").classes("vs-icon-button") as button:
        with ui.menu().classes("vs-information"), ui.element("dl"):
            for name, text in rows:
                with ui.element("dt"):
                    ui.label(name)
                with ui.element("dd").classes("vs-noted" if name == NOTE else ""):
                    ui.label(text)
    if notes:
        button.classes("vs-has-notes")
    button.props["aria-label"] = button.props["title"] = said
