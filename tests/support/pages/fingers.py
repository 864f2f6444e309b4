"""Fingers on a page, as a touch screen tells of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

Place = tuple[float, float]


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
