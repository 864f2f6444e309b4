"""Fingers on a page, as a touch screen tells of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

Place = tuple[float, float]

# On an element, to these distances of the fingers from what they were; it fails unless the page keeps its own zoom.
SAFARI_PINCH = """(element, scales) => {
    const { x, y, width, height } = element.getBoundingClientRect();
    const told = (kind, scale) => {
        const at = { clientX: x + width / 2, clientY: y + height / 2, bubbles: true, cancelable: true };
        const event = Object.assign(new MouseEvent(kind, at), { scale });
        if (element.dispatchEvent(event)) throw new Error(`${kind} is left to the browser`);
    };
    told("gesturestart", 1);
    for (const scale of scales) told("gesturechange", scale);
}"""


@contextmanager
def on_finer_screen(page: Page) -> Iterator[None]:
    """The window is on a screen with twice as many pixels to a side within, where all is as large as before.

    It is a pixel narrower there: of the other alone Chromium tells no page, when it is only played.
    """
    session = page.context.new_cdp_session(page)

    def show_on(pixels: int, width: int) -> None:
        window = {"width": width, "height": 800, "deviceScaleFactor": pixels, "mobile": False}
        session.send("Emulation.setDeviceMetricsOverride", window)

    show_on(2, 1279)
    yield
    show_on(1, 1280)
    session.detach()


def fingers_on(page: Page) -> Callable[..., None]:
    """Says what fingers do, numbered from `first` on: `touch("touchStart", (x, y), …)`.

    "touchEnd" is given the places of those that are lifted, or none for all.
    """
    session = page.context.new_cdp_session(page)

    def touch(kind: str, *places: Place, first: int = 0) -> None:
        told = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(places, first)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": told})

    return touch


def pinch(touch: Callable[..., None], begin: tuple[Place, Place], *then: tuple[Place, Place]) -> None:
    """Two fingers, one down before the other, that move on and are lifted."""
    touch("touchStart", begin[0])
    touch("touchStart", *begin)
    for places in then:
        touch("touchMove", *places)
    touch("touchEnd")
