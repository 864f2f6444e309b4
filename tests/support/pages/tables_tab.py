"""A person's hands on the tables' panel: where things lie in the window, and the scene behind it.

tests/ui/tables/conftest.py has the fixtures: one program for all modules, and one tab that is loaded anew only where a
test has left it otherwise.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import msgspec
import pytest

from support.checkout import ROOT
from support.pages.tables_page import SCENE, State
from support.patience import PATIENCE
from tolerances import ONE_PIXEL_OF_A_TABLE
from volsplat.client.ui.tables.table_edits import Table
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import Tables

if TYPE_CHECKING:
    from playwright.sync_api import FloatRect, Locator, Page

PROGRAM = "support.pages.tables_page"
BUILT = '[aria-label="Modulation"] circle[role=slider]'
TITLES = {"emit": "Emitted", "refl": "Reflected", "opac": "Opacity", "modu": "Modulation"}


class Tab:
    """A tab on the panel, and the scene behind it."""

    def __init__(self, page: Page, url: str) -> None:
        self.page = page
        self.url = url

    def load(self, path: str = "/") -> Tab:
        self.page.goto(f"{self.url}{path}")
        self.page.wait_for_selector(BUILT)
        self.page.wait_for_function("() => window.did_handshake")  # until then it keeps what it has to say
        return self

    @property
    def state(self) -> State:
        return msgspec.json.decode(self.page.request.get(f"{self.url}/state").body(), type=State)

    @property
    def scene(self) -> Scene:
        return self.state.scene

    @property
    def tables(self) -> Tables:
        return self.scene.tables

    def table(self, which: str) -> Locator:
        return self.page.locator(f'section[aria-label="{TITLES[which]}"]')

    def points(self, which: str) -> Locator:
        return self.table(which).locator("circle[role=slider]")

    def waits_for(self, holds: Callable[[Scene], bool]) -> Scene:
        """The scene, as soon as it is so."""
        return self._state_in_which(lambda state: holds(state.scene)).scene

    def becomes(self, which: str, table: Table) -> None:
        """Wait until a table is this, and the others are as at the beginning."""
        tables = msgspec.structs.replace(SCENE.tables, **{which: table})
        self.waits_for(lambda scene: scene.tables == tables)

    def settles(self, holds: Callable[[Scene], bool]) -> Scene:
        """The scene, as soon as it is so and the hand has let go of it."""
        return self._state_in_which(lambda state: state.settled and holds(state.scene)).scene

    def _state_in_which(self, holds: Callable[[State], bool]) -> State:
        found: list[State] = []

        def look() -> bool:
            found.append(self.state)
            return holds(found[-1])

        until(self.page, look)
        return found[-1]

    def place(self, which: str, position: float, value: float) -> tuple[float, float]:
        """Where a table's position and value lie in the window, by its own first and last grid lines."""
        lines = self.table(which).locator('[data-part="grid"] line')
        top, bottom = box(lines.nth(2)), box(lines.nth(0))
        return (top["x"] + position * top["width"], bottom["y"] + value * (top["y"] - bottom["y"]))

    def on_strip(self, which: str, position: float) -> tuple[float, float]:
        strip = box(self.table(which).locator('[data-part="strip"]'))
        return (strip["x"] + position * strip["width"], strip["y"] + strip["height"] / 2)

    def drag(self, start: tuple[float, float], *way: tuple[float, float]) -> None:
        self.page.mouse.move(*start)
        self.page.mouse.down()
        for place in way:
            self.page.mouse.move(*place, steps=5)
        self.page.mouse.up()

    def choose(self, which: str, *items: str) -> None:
        """Click through a table's menu."""
        self.page.get_by_label(f"{TITLES[which]}: more").click()
        for item in items:
            self.page.locator(".vs-menu .q-item").filter(has_text=item).last.click()

    def field(self, which: str, name: str) -> Locator:
        return self.table(which).locator(f'input[name="{name}"]')

    def types(self, which: str, name: str, text: str) -> None:
        self.field(which, name).fill(text)
        self.field(which, name).press("Enter")

    def complaint(self, which: str) -> str:
        return self.table(which).get_by_role("alert").inner_text()


def until(page: Page, holds: Callable[[], bool]) -> None:
    """Wait until it holds, letting the page go on."""
    for _ in range(int(50 * PATIENCE)):
        if holds():
            return
        page.wait_for_timeout(20)
    raise AssertionError("what the page was to do did not happen")


def box(locator: Locator) -> FloatRect:
    """Where it lies; waited for, since a plot that is just drawn anew has no lines for a moment."""
    found: list[FloatRect] = []

    def look() -> bool:
        place = locator.bounding_box()
        if place is not None:
            found.append(place)
        return place is not None

    until(locator.page, look)
    return found[0]


def near(value: float) -> object:
    return pytest.approx(value, abs=ONE_PIXEL_OF_A_TABLE)


def begin_anew(page: Page) -> None:
    """Have another session begin in the same page."""
    begun = page.locator("[data-begun]").inner_text()
    page.locator(".vs-foot button").dispatch_event("click")
    page.locator(f'[data-begun]:not(:text-is("{begun}"))').wait_for()
    page.wait_for_selector(BUILT)


@contextmanager
def tables_program() -> Iterator[str]:
    """Its address."""
    command = [sys.executable, "-m", PROGRAM]
    with subprocess.Popen(command, cwd=ROOT / "tests", stdout=subprocess.PIPE, encoding="utf-8") as program:
        assert program.stdout is not None
        yield program.stdout.readline().strip()
        program.terminate()
