"""The table about the volume: readers' notes come first, and the button says how many there are."""

from dataclasses import replace

import msgspec
import pytest
from nicegui import Client, ui
from nicegui.page import page

from support.pages.tables_page import VOLUME
from volsplat.client.ui.panels.volume_information import volume_information
from volsplat.client.volume.surveyed_volume import SurveyedVolume


def built(volume: SurveyedVolume) -> tuple[ui.button, list[str]]:
    """The button, and the table's texts in their order."""
    with Client(page("/")) as client:
        volume_information(volume)
        (button,) = (element for element in client.elements.values() if isinstance(element, ui.button))
        return button, [element.text for element in client.elements.values() if isinstance(element, ui.label)]


@pytest.mark.parametrize(
    ("notes", "said"),
    [
        ((), "about this volume"),
        (("water is left out",), "about this volume: 1 note of its reader"),
        (("water is left out", "2000 m/s are assumed"), "about this volume: 2 notes of its reader"),
    ],
)
def test_notes_come_first_and_are_counted(notes: tuple[str, ...], said: str) -> None:
    description = msgspec.structs.replace(VOLUME.description, warnings=notes)
    button, texts = built(replace(VOLUME, description=description))
    assert button.props["aria-label"] == said
    assert texts[: 2 * len(notes)] == [text for note in notes for text in ("note", note)]
    assert "made-up.nrrd (NRRD)" in texts
