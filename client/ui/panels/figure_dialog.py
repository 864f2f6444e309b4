"""The page's dialog for figures: the picture with scale, colours, sides and a title, as large as it is printed."""

from __future__ import annotations

import asyncio
import threading

from nicegui import context, ui

from volsplat.client.figure.figure import PRINTED_DPI, PRINTED_TEXT, Figure, figure_with, label_from_text
from volsplat.client.ui.controls.side_dialog import SideDialog
from volsplat.client.ui.doors.handed_files import hand_bytes
from volsplat.client.ui.viewing.idle_drawing import IdleDrawing
from volsplat.client.ui.viewing.saving import FIGURE_KINDS, figure_bytes, why_unlabelled
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene_key import Key, Switch, declarations
from volsplat.protocol.text.errors import BadInput, VolsplatError

WIDTH = 8.5  # cm: of a journal's column


class FigureDialog:
    """One tab's dialog, beside which the volume can still be turned: a figure is drawn while nobody does so."""

    def __init__(self, viewing: Viewing, name: str, opener: ui.button) -> None:
        self._viewing = viewing
        self._name = name
        self._left = threading.Event()  # the tab is gone
        usual = Figure()
        self._dialog = SideDialog("Figure", opener)
        with self._dialog.card:
            with ui.row():
                self._switches = {
                    declared.name: ui.switch(declared.key.widget.label, value=getattr(usual, declared.name))
                    for declared in declarations(Figure)
                    if isinstance(declared.key, Key) and isinstance(declared.key.widget, Switch)
                }
            self._title = ui.input("title").props("dense").classes("w-full")
            self._labels = ui.textarea("labels, each TEXT@I,J,K").props("dense autogrow rows=1").classes("w-full")
            with ui.row():
                self._width = ui.number("width, cm", value=WIDTH).props("dense")
                self._dpi = _number_or_usual("pixels per inch", PRINTED_DPI)
            with ui.row():
                self._text_size = _number_or_usual("words, points", PRINTED_TEXT)
                self._kind = ui.select(list(FIGURE_KINDS), value=FIGURE_KINDS[0], label="kind").props("dense")
            ui.label("without a width it has the pixels of the picture on the page").classes("vs-muted")
            self._trouble = ui.label("").classes("vs-bad").props("role=alert")
            with ui.row().classes("justify-end w-full"):
                self._make = ui.button("make the figure", on_click=self._save).props("no-caps")
                ui.button("close", on_click=self._dialog.close).props("flat no-caps")
        context.client.on_delete(self._left.set)

    def open(self) -> None:
        self._dialog.open()

    async def _save(self) -> None:
        self._trouble.text = ""
        self._make.disable()
        drawing = IdleDrawing(self._viewing.session, self._viewing.loop)
        kind = self._kind.value
        try:
            figure, scene = self._figure(), self._viewing.model.scene
            data = await asyncio.to_thread(figure_bytes, drawing, scene, figure, kind, self._left.is_set)
            if data is not None:
                await hand_bytes(data, f"{self._name}{kind}")
                if why := why_unlabelled(figure, scene, self._viewing.volume):
                    ui.notify(why, type="warning", timeout=0, close_button=True)
        except VolsplatError as error:
            self._trouble.text = str(error)
        finally:
            if not self._left.is_set():
                self._make.enable()

    def _figure(self) -> Figure:
        """Raises BadInput."""
        given = {
            "title": self._title.value,
            "width": self._width.value,
            "dpi": self._dpi.value,
            "text_size": self._text_size.value,
        }
        try:
            given["labels"] = [label_from_text(line) for line in self._labels.value.splitlines() if line.strip()]
        except ValueError as error:
            raise BadInput("labels: give TEXT@I,J,K in each line, as in nose@128,8,60 for a voxel") from error
        given |= {name: switch.value for name, switch in self._switches.items()}
        return figure_with(Figure(), {name: value for name, value in given.items() if value is not None})


def _number_or_usual(label: str, usual: float) -> ui.number:
    """Empty, which is the usual of what is printed; of a figure without a width what suits its picture."""
    return ui.number(label, placeholder=f"{usual:g}").props("dense stack-label")
