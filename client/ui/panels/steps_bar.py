"""The steps: which one is being drawn, how far it is, and what each took; and in which order images form."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import msgspec
from nicegui import context, ui
from nicegui.element import Element

from volsplat.client.session.frame_report import STEP_WORDS
from volsplat.client.ui.controls.controls import SceneEditor, show_pressed
from volsplat.client.ui.controls.throttle import Throttle
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.client.ui.viewing.pacing import Rung
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.running_step import progress
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import ORDER_WORDS, Order, Scene, Step
from volsplat.protocol.rules.resolved_view import resolved_order

INTERVAL = 0.1  # seconds between updates


def steps_bar(viewing: Viewing) -> None:
    """A chip for each step, and the order."""
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

    context.client.on_delete(viewing.on_picture(note))
    context.client.on_delete(viewing.model.subscribe(lambda _: throttle()))
    throttle()


@dataclass(frozen=True)
class ChipState:
    """How one chip looks. `fill`: seconds that its step will take, and has taken, while it is drawn."""

    current: bool
    finished: bool
    time: str
    fill: tuple[float, float] | None


class StepChips(Element, component="step_chips_component.js", esm=MODULES):
    """One chip a step: its letter, a bar that fills while it is drawn, and to who points at it what it took.

    It changes with every picture; NiceGUI would go over the whole page for that, so the browser is told by a call.
    """

    def __init__(self) -> None:
        super().__init__()
        self.props["steps"] = [{"letter": step.value, "title": f"step {step}: {STEP_WORDS[step]}"} for step in Step]
        self._shown: list[ChipState] = []

    def show(self, states: list[ChipState]) -> None:
        """One state a step."""
        if states != self._shown:
            self._shown = states
            self.run_method("show", [asdict(state) for state in states])


class StepsState:
    """What is known of the steps, as pictures come."""

    def __init__(self, viewing: Viewing) -> None:
        self._viewing = viewing
        self._seconds = {step: viewing.loop.pacing.expected(Rung(step)) for step in Step}
        self._running: tuple[int, Step] | None = None  # revision and step
        self._fill: tuple[float, float] | None = None  # of the running one

    def note(self, picture: Picture) -> None:
        """Remember what the picture's step took, in the size of the scene's image."""
        if picture.outcome is not None and picture.whole:
            self._seconds[picture.step] = picture.outcome.wall_seconds

    def chips(self) -> list[ChipState]:
        """How the chips should look now."""
        state, pacing = self._viewing.model.now, self._viewing.loop.pacing
        now = progress(self._viewing.pictures.newest, state, pacing.moving.step)
        running = (state.revision, now.running) if now.running else None
        if running != self._running:
            self._running = running
            expected = pacing.expected(Rung(now.running)) if now.running and state.settled else None
            self._fill = None if expected is None else (expected, 0.0)
        return [
            ChipState(
                current=step == (now.running or now.finished),
                finished=now.finished is not None and step <= now.finished,
                time="" if seconds is None else milliseconds(seconds),
                fill=self._fill if step == now.running else None,
            )
            for step, seconds in self._seconds.items()
        ]


def milliseconds(seconds: float) -> str:
    """As short as can be."""
    if seconds >= 9.95:
        return f"{seconds:.0f} s"
    return f"{seconds:.1f} s" if seconds >= 0.9995 else f"{1000 * seconds:.0f} ms"


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
