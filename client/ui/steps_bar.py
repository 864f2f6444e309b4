"""The steps A to F: which one is being drawn, how far it is, and what each took; and in which order images form."""

from __future__ import annotations

import time

import msgspec
from nicegui import context, ui
from nicegui.element import Element

from volsplat.client.frame_report import STEP_WORDS
from volsplat.client.ui.fields import SceneEditor, show_pressed, show_prop
from volsplat.client.ui.picture import Picture
from volsplat.client.ui.running_step import progress
from volsplat.client.ui.throttle import Throttle
from volsplat.client.ui.viewing import Viewing
from volsplat.protocol.frame_plan import resolved_order
from volsplat.protocol.scene import Order, Scene, Step

INTERVAL = 0.1  # seconds between updates
ORDER_WORDS = {Order.BACK_TO_FRONT: "back to front", Order.FRONT_TO_BACK: "front to back"}


def steps_bar(viewing: Viewing) -> None:
    """A chip for each step, and the order."""
    editor = SceneEditor(viewing.model, viewing.volume.description.geometry, "steps")
    with ui.element("div").classes("vs-steps").props('role=group aria-label="steps"'):
        chips = Chips(viewing)
    with ui.element("div").classes("vs-order"):
        _order(editor, viewing)
    throttle = Throttle(INTERVAL, chips.show)
    context.client.on_delete(throttle.cancel)

    def note(picture: Picture) -> None:
        chips.note(picture)
        throttle()

    context.client.on_delete(viewing.on_picture(note))
    context.client.on_delete(viewing.model.subscribe(lambda _: throttle()))
    chips.show()


class Chips:
    """The six chips of one tab."""

    def __init__(self, viewing: Viewing) -> None:
        self._viewing = viewing
        self._chips = {step: Chip(step, viewing.loop.pacing.expected(step)) for step in Step}
        self._running: tuple[int, Step] | None = None  # revision and step
        self._began = 0.0

    def note(self, picture: Picture) -> None:
        """Remember what the picture's step took."""
        if picture.outcome is not None:
            self._chips[picture.step].seconds = picture.outcome.wall_seconds

    def show(self) -> None:
        """Bring the chips to what is known now."""
        state, pacing = self._viewing.model.now, self._viewing.loop.pacing
        now = progress(self._viewing.pictures.newest, state, pacing.step_while_moving())
        running = (state.revision, now.running) if now.running else None
        if running != self._running:
            self._running, self._began = running, time.monotonic()
        for step, chip in self._chips.items():
            chip.show(
                current=step == (now.running or now.finished),
                finished=now.finished is not None and step <= now.finished,
            )
            expected = pacing.expected(step) if step == now.running and state.settled else None
            chip.fill(expected, time.monotonic() - self._began)


class Chip:
    """One step: its letter, the milliseconds that it took, and a bar that fills while it is drawn."""

    def __init__(self, step: Step, seconds: float | None) -> None:
        self.seconds = seconds
        self._filling = False
        self._times_filled = 0
        with ui.element("div").classes("vs-step").props(f"data-step={step}") as self._chip:
            self._chip.tooltip(f"step {step}: {STEP_WORDS[step]}")
            ui.label(step.value).classes("vs-step-letter")
            self._milliseconds = ui.label().classes("vs-step-time")
            with ui.element("div").classes("vs-step-track"):
                self._bar = Element("div").classes("vs-step-bar")

    def show(self, *, current: bool, finished: bool) -> None:
        for name, on in (("vs-now", current), ("vs-done", finished)):
            self._chip.classes(add=name if on else "", remove="" if on else name)
        show_prop(self._chip, "aria-current", "step" if current else "false")
        self._milliseconds.set_text("" if self.seconds is None else milliseconds(self.seconds))

    def fill(self, expected: float | None, elapsed: float) -> None:
        """Have the bar fill within `expected` seconds from `elapsed` seconds ago; None empties it."""
        if expected is None:
            if self._filling:
                self._bar.style(replace="")
            self._filling = False
        elif not self._filling:
            self._filling = True
            self._times_filled += 1  # another name starts the browser's animation anew
            name = f"vs-fill-{self._times_filled % 2}"
            self._bar.style(replace=f"animation: {name} {expected:.3f}s linear {-elapsed:.3f}s forwards")


def milliseconds(seconds: float) -> str:
    """Short enough to stand beneath a letter."""
    if seconds >= 9.95:
        return f"{seconds:.0f} s"
    return f"{seconds:.1f} s" if seconds >= 0.9995 else f"{1000 * seconds:.0f} ms"


def _order(editor: SceneEditor, viewing: Viewing) -> None:
    def toggle() -> None:
        order = Order.FASTEST if editor.scene.order == Order.BACK_TO_FRONT else Order.BACK_TO_FRONT
        editor.change(lambda scene: msgspec.structs.replace(scene, order=order))

    words = ui.label().classes("vs-muted")
    button = ui.button("paper’s order", color=None, on_click=toggle).props("dense flat no-caps").classes("vs-press")
    button.tooltip("let the image form back to front, as in the paper")

    def show(scene: Scene) -> None:
        words.set_text(f"forms {ORDER_WORDS[resolved_order(scene, viewing.volume.description.geometry)]}")
        show_pressed(button, scene.order == Order.BACK_TO_FRONT)

    editor.follow(show)
