"""What a page and its panels are given: the session, its one scene, and the pictures as they come."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from volsplat.client.session.session import Session
from volsplat.client.ui.viewing.drawing_loop import DrawingLoop
from volsplat.client.ui.viewing.image_size import ImageSize
from volsplat.client.ui.viewing.known_pushes import KnownPushes
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.ui.viewing.trouble import OVER, Trouble
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene

Unsubscribe = Callable[[], None]


News = TypeVar("News")


class Feed(Generic[News]):
    """Passes on what a thread tells, newest known, to subscribers in the event loop's thread."""

    def __init__(self) -> None:
        self.newest: News | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._subscribers: list[Callable[[News], None]] = []

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Tell subscribers in this loop's thread from now on."""
        self._loop = loop

    def tell(self, news: News) -> None:
        """From any thread. Before a loop is attached nobody has subscribed."""
        if self._loop is None:
            self._note(news)
        else:
            with suppress(RuntimeError):  # the loop is closed, at any moment: nobody looks any more
                self._loop.call_soon_threadsafe(self._pass_on, news)

    def subscribe(self, subscriber: Callable[[News], None]) -> Unsubscribe:
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    async def next(self, wanted: Callable[[News], bool]) -> News:
        """The first from now on that is wanted."""
        found: asyncio.Future[News] = asyncio.get_running_loop().create_future()

        def look(news: News) -> None:
            if wanted(news) and not found.done():
                found.set_result(news)

        leave = self.subscribe(look)
        try:
            return await found
        finally:
            leave()

    def _note(self, news: News) -> None:
        self.newest = news

    def _pass_on(self, news: News) -> None:
        self._note(news)
        for subscriber in list(self._subscribers):
            subscriber(news)


class Troubles(Feed[Trouble]):
    """Lines for the person: one that lasts stays while others come and pass."""

    def __init__(self) -> None:
        super().__init__()
        self.lasting: Trouble | None = None

    def tell_end(self, text: str) -> None:
        """What lasted is over, and this is told of it, in passing."""
        self.tell(OVER)
        self.tell(Trouble(text))

    def _note(self, news: Trouble) -> None:
        super()._note(news)
        if news.lasting:
            self.lasting = None if news == OVER else news


@dataclass
class Viewing:
    """One volume being looked at, by any number of tabs; only its session may be another one after some time."""

    session: Session
    model: SceneModel
    loop: DrawingLoop
    volume: SurveyedVolume
    default_scene: Scene
    pictures: Feed[Picture]
    troubles: Troubles
    cure: str  # what a person may do once the session has ended
    image_size: ImageSize = field(default_factory=ImageSize)
    pushes: KnownPushes = field(default_factory=KnownPushes)
    number: int = 1  # of the volumes that were shown, one after the other
    jobs: int = 0  # that need the session for long, as movies do
    _on_left: list[Callable[[], None]] = field(default_factory=list)
    _guard: threading.Lock = field(default_factory=threading.Lock)  # of the session and of what follows
    _closed: bool = False

    def take(self, session: Session) -> None:
        """Look through this session from now on, which ends with the viewing: at once if that is over."""
        with self._guard:
            self.session = session
            closed = self._closed
        if closed:
            session.close()

    def close(self) -> None:
        """End the session, whichever it is by now. Safe to call twice."""
        with self._guard:
            self._closed = True
            session = self.session
        session.close()

    def on_left(self, subscriber: Callable[[], None]) -> Unsubscribe:
        """Have `subscriber` called when another volume is shown in the place of this one."""
        self._on_left.append(subscriber)
        return lambda: self._on_left.remove(subscriber)

    def left(self) -> None:
        """Another volume is shown. In the event loop's thread."""
        for subscriber in list(self._on_left):
            subscriber()

    def show_scene(self, scene: Scene) -> None:
        """Put another scene in place of the present one, which undo brings back; the image has its size as before."""
        self.model.change(lambda _: self.image_size.fitted(scene))
