"""The one scene of a session, which every tab, widget and drawing loop shares, with undo.

It knows nothing of pages, sockets or drawing. All calls come from one thread, the event loop's; `now` may be read
from any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import msgspec

from volsplat.client.scene.resized import sized
from volsplat.protocol.description.scene import Image, Scene, View

MOST_UNDONE = 200  # changes that can be taken back


@dataclass(frozen=True)
class SceneState:
    """The scene at one moment.

    `settled` is false while a person is still at it (dragging): then a coarser step will do. `by` names the tab or
    panel that changed it last. `events` tells for each tab the last of its pointer events that is in the scene.
    """

    scene: Scene
    revision: int
    settled: bool = True
    by: str = ""
    events: dict[str, int] = field(default_factory=dict)


Subscriber = Callable[[SceneState], None]


class SceneModel:
    """Takes changes, remembers what can be undone, and tells its subscribers."""

    def __init__(self, scene: Scene, fitted: Callable[[Scene], Scene] = lambda scene: scene) -> None:
        """`fitted` gives a scene that asks for a fit its numbers: they stay, whatever is done to the tables then."""
        self._fitted = fitted
        self._state = SceneState(fitted(scene), 1)
        self._before: list[Scene] = []  # for undo, oldest first
        self._after: list[Scene] = []  # for redo
        self._gesture: Scene | None = None  # the scene before the change that is not yet settled
        self._held: set[str] = set()  # who made changes and has not settled them yet
        self._subscribers: list[Subscriber] = []

    @property
    def now(self) -> SceneState:
        return self._state

    @property
    def scene(self) -> Scene:
        return self._state.scene

    def change(
        self,
        edit: Callable[[Scene], Scene],
        *,
        by: str = "",
        settled: bool = True,
        event: int | None = None,
    ) -> None:
        """Replace the scene by `edit(scene)`.

        A row of changes that are not settled, and the settled one that ends it, are undone as one; the image's size
        stays. Raises ValueError if the edit makes no valid scene; the last good one stays in force.
        """
        if settled:
            self._held.discard(by)
        scene = self._fitted(edit(self.scene))
        if not _same_but_for_size(self.scene, scene):
            if self._gesture is None:
                self._gesture = self.scene
            self._after.clear()
        if settled:
            self._end_gesture(scene)
        else:
            self._held.add(by)
        self._publish(scene, by, settled, event)

    def resize(self, edit: Callable[[Scene], Scene], by: str) -> None:
        """Likewise for the image's size alone, which no hand holds: whoever is at the scene goes on."""
        self._publish(self._fitted(edit(self.scene)), by, self._state.settled)

    def let_go(self, by: str) -> None:
        """Who made changes is gone: what that one was at is settled, unless others hold the scene as well."""
        if by in self._held:
            self._held.discard(by)
            if not self._state.settled and not self._held:
                self.change(lambda scene: scene, by=by)

    @property
    def can_undo(self) -> bool:
        return bool(self._before)

    @property
    def can_redo(self) -> bool:
        return bool(self._after)

    def undo(self, by: str = "") -> None:
        """Take the last change back, but for the image's size."""
        self._held.discard(by)
        self._end_gesture(self.scene)
        if self._before:
            self._after.append(self.scene)
            self._publish(_in_size_of(self.scene, self._before.pop()), by)

    def redo(self, by: str = "") -> None:
        """Make the last undone change again."""
        self._held.discard(by)
        if self._after:
            self._before.append(self.scene)
            self._publish(_in_size_of(self.scene, self._after.pop()), by)

    def forget(self) -> None:
        """Nothing can be undone from here on: the scene is the first one."""
        self._gesture = None
        self._before.clear()
        self._after.clear()

    def subscribe(self, subscriber: Subscriber) -> Callable[[], None]:
        """Have `subscriber` called after every change, in the thread that made it. Returns what ends that."""
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    def _end_gesture(self, scene: Scene) -> None:
        """What led here from the scene before the gesture is one change."""
        if self._gesture is not None and not _same_but_for_size(self._gesture, scene):
            self._before = [*self._before, self._gesture][-MOST_UNDONE:]
        self._gesture = None

    def _publish(self, scene: Scene, by: str, settled: bool = True, event: int | None = None) -> None:
        events = self._state.events if event is None else {**self._state.events, by: event}
        self._state = SceneState(scene, self._state.revision + 1, settled, by, events)
        for subscriber in list(self._subscribers):
            subscriber(self._state)


def but_for_view(scene: Scene) -> Scene:
    """What is shown, from wherever and however large: the same for all scenes that turning one makes."""
    return msgspec.structs.replace(scene, view=View(), image=Image())


def _in_size_of(shown: Scene, scene: Scene) -> Scene:
    return sized(scene, width=shown.image.width, height=shown.image.height)


def _same_but_for_size(one: Scene, other: Scene) -> bool:
    return _in_size_of(other, one) == other
