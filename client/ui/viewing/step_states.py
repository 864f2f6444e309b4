"""What is known of the steps as pictures come: which one is being drawn, how far it is, and what each took."""

from __future__ import annotations

from dataclasses import dataclass

from volsplat.client.session.frame_report import step_words
from volsplat.client.ui.viewing.pacing import Rung
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.running_step import progress
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.rules.refinement import coarser


def step_letters() -> list[str]:
    """One for each chip."""
    return [step.value for step in Step]


def step_title(scene: Scene, step: Step) -> str:
    """What a step of this scene is, and which light joins there."""
    words = step_words(scene, step)
    return f"step {step}: {', '.join(words) if words else f'the same picture as step {coarser(step)}'}"


@dataclass(frozen=True)
class ChipState:
    """How one chip looks. `fill`: seconds that its step will take, and has taken, while it is drawn."""

    current: bool
    finished: bool
    title: str
    time: str
    fill: tuple[float, float] | None


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
                title=step_title(state.scene, step),
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
