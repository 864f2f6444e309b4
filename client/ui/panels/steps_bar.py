"""The steps: which one is being drawn, how far it is, and what each took; and in which order images form."""

from __future__ import annotations

from dataclasses import asdict

import msgspec
from nicegui import context, ui
from nicegui.element import Element

from volsplat.client.ui.controls.controls import SceneEditor, show_pressed
from volsplat.client.ui.controls.throttle import Throttle
from volsplat.client.ui.doors.static_files import MODULES, STATIC
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.step_states import ChipState, StepsState, step_letters
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import ORDER_WORDS, Order, Scene
from volsplat.protocol.rules.resolved_view import resolved_order

STYLE = STATIC / "controls" / "step_chips.css"
INTERVAL = 0.1  # seconds between updates


def steps_bar(viewing: Viewing) -> None:
    """A chip for each step, and the order."""
    ui.add_css(STYLE)
    editor = SceneEditor(viewing.model, viewing.volume.description.geometry, "steps")
    chips = StepChips()
    state = StepsState(viewing)
    with ui.element("div").classes("vs-order"):
        _order(editor, viewing)
    throttle = Throttle(INTERVAL, lambda: chips.show(state.chips()))
    context.client.on_delete(throttle.cancel)

    def note(picture: Picture) -> None:
        state.note(picture)
        throttle()

    context.client.on_delete(viewing.pictures.subscribe(note))
    context.client.on_delete(viewing.model.subscribe(lambda _: throttle()))
    throttle()


class StepChips(Element, component="step_chips_component.js", esm=MODULES):
    """One chip a step: its letter, a bar that fills while it is drawn, and to who points at it what it took.

    It changes with every picture; NiceGUI would go over the whole page for that, so the browser is told by a call.
    """

    def __init__(self) -> None:
        super().__init__()
        self.props["steps"] = step_letters()
        self._shown: list[ChipState] = []

    def show(self, states: list[ChipState]) -> None:
        """One state a step."""
        if states != self._shown:
            self._shown = states
            self.run_method("show", [asdict(state) for state in states])


def _order(editor: SceneEditor, viewing: Viewing) -> None:
    def toggle() -> None:
        order = Order.FASTEST if editor.scene.order == Order.BACK_TO_FRONT else Order.BACK_TO_FRONT
        editor.change(lambda scene: msgspec.structs.replace(scene, order=order))

    words = ui.label().classes("vs-muted")
    button = ui.button("back to front", color=None, on_click=toggle)
    button.props("dense flat no-caps").classes("vs-press")
    button.tooltip("always combine samples back to front, as in the paper, so that what is later hidden is seen first")

    def show(scene: Scene) -> None:
        words.set_text(f"drawn {ORDER_WORDS[resolved_order(scene, viewing.volume.description.geometry)]}")
        show_pressed(button, scene.order == Order.BACK_TO_FRONT)

    editor.follow(show)
