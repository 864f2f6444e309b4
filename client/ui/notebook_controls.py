"""The steps and tables beside the viewport in a notebook: what is said between one view of them and the scene."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import msgspec

from volsplat.client.ui.controls.throttle import Throttle
from volsplat.client.ui.tables.scene_tables import IndexedFields, table_of, with_table
from volsplat.client.ui.tables.table_edits import table_from_points
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.client.ui.viewing.step_states import StepsState, step_letters
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import TABLE_WORDS
from volsplat.protocol.description.shading_tables import ColourTable
from volsplat.protocol.text.errors import BadInput

INTERVAL = 0.1  # seconds between two looks at the steps

replace = msgspec.structs.replace


class TableChanged(msgspec.Struct, tag="table", frozen=True):
    """A person is changing a table, for the `number`th time; settled when that ends."""

    which: str
    number: int
    points: list[Any]
    settled: bool
    freehand: bool


class FinestChosen(msgspec.Struct, tag="finest", frozen=True):
    """The image is to refine to this step."""

    finest: Step


class ControlsTalk:
    """One open view of the controls. `send` is given what to show there."""

    def __init__(self, viewing: Viewing, view: str, send: Callable[[dict[str, Any]], None]) -> None:
        self._viewing, self._view, self._send = viewing, view, send
        self._fields = IndexedFields(viewing.volume)
        self._answers = dict.fromkeys(TABLE_WORDS, 0)  # of each table, the number of the last change made there
        self._tables: dict[str, dict[str, Any]] = {}  # as they were told
        self._finest: Step | None = None  # likewise
        self._steps = StepsState(viewing)
        self._throttle = Throttle(INTERVAL, lambda: send({"chips": [asdict(chip) for chip in self._steps.chips()]}))
        self._subscriptions = contextlib.ExitStack()

    def begin(self) -> None:
        """Tell all that there is, and from now on what changes."""
        self._send({"steps": step_letters(), "without_g": self._viewing.volume.why_without(Step.G)})
        self._on_scene(self._viewing.model.now)
        self._subscriptions.callback(self._throttle.cancel)
        self._subscriptions.callback(self._viewing.model.subscribe(self._on_scene))
        self._subscriptions.callback(self._viewing.pictures.subscribe(self._on_picture))

    def end(self) -> None:
        self._subscriptions.close()
        for which in TABLE_WORDS:
            self._viewing.model.let_go(self._by(which))

    def heard(self, content: dict[str, Any]) -> None:
        """Do what a person did there; what is no scene is told at its table."""
        said = msgspec.convert(content, TableChanged | FinestChosen)
        if isinstance(said, FinestChosen):
            self._viewing.model.change(
                lambda scene: replace(scene, refine=replace(scene.refine, finest=said.finest)), by=self._by("steps")
            )
            return
        self._answers[said.which] = said.number
        try:
            self._change_table(said)
        except (BadInput, ValueError) as error:
            self._tables.pop(said.which, None)  # the person sees another one than there is
            self._tell_tables(self._viewing.model.scene)
            self._send({"complaint": {"which": said.which, "text": str(error)}})

    def _change_table(self, said: TableChanged) -> None:
        like, drawn = table_of(self._viewing.model.scene, said.which), said.settled and said.freehand
        table = table_from_points(like, said.points, drawn)
        self._viewing.model.change(
            lambda scene: with_table(scene, said.which, table), by=self._by(said.which), settled=said.settled
        )

    def _by(self, what: str) -> str:
        return f"{self._view} {what}"

    def _on_scene(self, state: SceneState) -> None:
        self._tell_tables(state.scene)
        self._throttle()

    def _on_picture(self, picture: Picture) -> None:
        self._steps.note(picture)
        self._throttle()

    def _tell_tables(self, scene: Scene) -> None:
        now = {which: self._shown(scene, which) for which in TABLE_WORDS}
        changed = {which: shown for which, shown in now.items() if shown != self._tables.get(which)}
        self._tables = now
        if changed or scene.refine.finest is not self._finest:  # not with every move of the hand
            self._finest = scene.refine.finest
            self._send({"finest": self._finest.value, "tables": changed})

    def _shown(self, scene: Scene, which: str) -> dict[str, Any]:
        table, field = table_of(scene, which), self._fields.of(scene, which)
        return {
            "name": TABLE_WORDS[which],
            "colour": isinstance(table, ColourTable),
            "points": table.points,
            "answers": self._answers[which],
            "axis": asdict(field.axis),
            "histogram": field.histogram,
            "unused": field.unused,
            "tint": field.tint,
        }
