"""The 2-D table's editor in a real browser, with servers that count the histogram: by pointer and by keys."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import msgspec
import pytest

from support.checkout import ROOT
from support.pages.browser import browser, browser_page
from support.pages.panels_page import State
from support.patience import PATIENCE
from volsplat.client.phantoms.make_phantom import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.controls.patches_control import SIDE
from volsplat.protocol.description.patches import Patch

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

__all__ = ["browser", "browser_page"]

ENTRY = 1 / 255


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    path = tmp_path_factory.mktemp("volumes") / "shells.nrrd"
    write_volume(path, *make_phantom("shells", size=(24, 20, 16)))
    command = [sys.executable, "-m", "support.pages.panels_page", str(path)]
    with subprocess.Popen(command, cwd=ROOT / "tests", stdout=subprocess.PIPE, encoding="utf-8") as program:
        assert program.stdout is not None
        yield program.stdout.readline().strip()
        program.terminate()


class Tab:
    """A tab on the panels, and the patches behind it."""

    def __init__(self, page: Page, url: str) -> None:
        self.page, self.url = page, url
        page.goto(url)
        page.wait_for_selector(".vs-plane-plot")
        page.wait_for_function("() => window.did_handshake")
        revision = page.request.get(f"{url}/again").text()
        page.locator("[data-revision]", has_text=revision).wait_for()
        self.panel = page.get_by_role("region", name="2-D table")
        self.panel.scroll_into_view_if_needed()

    def until(self, holds: Callable[[tuple[Patch, ...]], bool]) -> tuple[Patch, ...]:
        """The patches, as soon as they are so and settled."""
        for _ in range(int(50 * PATIENCE)):
            state = msgspec.json.decode(self.page.request.get(f"{self.url}/state").body(), type=State)
            if state.settled and holds(state.scene.plane.patches):
                return state.scene.plane.patches
            self.page.wait_for_timeout(20)
        raise AssertionError(f"the patches did not become what they were to be: {state.scene.plane.patches}")

    def add(self, count: int = 1) -> Patch:
        self.panel.get_by_role("button", name="Add a patch").click()
        return self.until(lambda patches: len(patches) == count)[-1]

    def handle(self, name: str) -> Locator:
        return self.panel.get_by_role("slider", name=name)

    def drag(self, grabbed: Locator, right: float, up: float) -> None:
        box = grabbed.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + right, y - up, steps=4)
        self.page.mouse.up()


@pytest.fixture
def tab(browser_page: Page, url: str) -> Tab:
    return Tab(browser_page, url)


def test_the_histogram_is_that_of_the_servers(tab: Tab) -> None:
    tab.page.wait_for_selector(".vs-plane[data-counted=yes]")
    filled = tab.page.evaluate(
        """() => {
          const canvas = document.querySelector(".vs-plane-plot canvas");
          const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          return [canvas.width, data.filter((_, n) => n % 4 === 3 && data[n] > 0).length];
        }"""
    )
    assert filled[0] == SIDE and 30 < filled[1] < SIDE * SIDE


def test_patches_are_added_moved_stretched_and_taken_away(tab: Tab) -> None:
    first = tab.add()
    assert first == Patch(density=(0.4, 0.6), strength=(0.3, 0.7), opacity=0.3, refl=first.refl)
    tab.drag(tab.handle("patch 1, upper right"), 20, 12)
    (higher,) = tab.until(lambda patches: patches[0].strength[1] > 0.72)
    assert higher.ends[1][1] > 0.65 and higher.density == (0.4, 0.6)  # that corner alone
    tab.drag(tab.handle("patch 1, left side"), -15, 30)
    (wider,) = tab.until(lambda patches: patches[0].density[0] < 0.38)
    assert wider.ends[1][0] < 0.38 and wider.strength == higher.strength
    tab.drag(tab.panel.locator(".vs-patch"), 12, -9)
    (moved,) = tab.until(lambda patches: patches[0].density[0] > wider.density[0] + 0.02)
    assert moved.density[1] - moved.density[0] == pytest.approx(wider.density[1] - wider.density[0], abs=1e-4)
    assert moved.strength[0] < wider.strength[0]
    tab.add(2)
    tab.panel.get_by_role("button", name="remove the patch").click()
    assert tab.until(lambda patches: len(patches) == 1) == (moved,)


def test_keys_do_all_that_the_pointer_does(tab: Tab) -> None:
    tab.add()
    tab.page.keyboard.press("ArrowRight")
    (moved,) = tab.until(lambda patches: patches[0].density[0] > 0.4)
    assert moved.density == pytest.approx((0.4 + ENTRY, 0.6 + ENTRY), abs=1e-5)
    tab.handle("patch 1, lower left").focus()
    tab.page.keyboard.press("Shift+ArrowUp")
    (shorter,) = tab.until(lambda patches: patches[0].strength[0] > 0.3)
    assert shorter.strength == pytest.approx((0.3 + ENTRY / 10, 0.7), abs=1e-5)
    tab.page.keyboard.press("Delete")
    tab.until(lambda patches: patches == ())
    assert tab.page.evaluate("() => document.activeElement.name") == "add"


def test_fields_set_the_rest_and_patches_are_named(tab: Tab) -> None:
    from playwright.sync_api import expect

    tab.add()
    tab.panel.get_by_label("opacity of the patch").fill("0.85")
    tab.panel.get_by_label("softness of the patch").fill("0.1")
    tab.panel.get_by_label("colour that the patch emits").fill("#102030")
    (patch,) = tab.until(lambda patches: max(patches[0].emit) > 0)
    assert (patch.opacity, patch.soft) == (0.85, 0.1) and patch.emit == pytest.approx((16 / 255, 32 / 255, 48 / 255))
    named = tab.panel.get_by_role("button", name="patch 1 of 1: from")
    expect(named).to_have_attribute("aria-pressed", "true")
    expect(tab.panel.get_by_text("None: the four tables decide")).to_be_hidden()


def place(handle: Locator) -> list[str | None]:
    return [handle.get_attribute(side) for side in ("cx", "cy")]


def press(tab: Tab, grabbed: Locator) -> tuple[float, float]:
    box = grabbed.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    return x, y


def test_escape_takes_a_drag_back(tab: Tab) -> None:
    first = tab.add()
    handle = tab.handle("patch 1, upper right")
    begun = place(handle)
    x, y = press(tab, handle)
    tab.page.mouse.move(x + 30, y - 20, steps=4)
    assert place(handle) != begun
    tab.page.keyboard.press("Escape")
    assert place(handle) == begun
    tab.page.mouse.move(x + 60, y - 20, steps=4)
    tab.page.mouse.up()
    assert place(handle) == begun
    tab.until(lambda patches: patches == (first,))


def test_what_others_do_during_a_press_is_seen_once_it_ends_without_a_move(tab: Tab) -> None:
    tab.add()
    other = tab.page.context.new_page()
    other.goto(tab.url)
    other.wait_for_function("() => window.did_handshake")
    shapes, shown = tab.panel.locator(".vs-patch"), other.get_by_role("region", name="2-D table").locator(".vs-patch")
    shown.nth(0).wait_for()
    press(tab, tab.panel.locator(".vs-patch"))
    other.get_by_role("region", name="2-D table").get_by_role("button", name="Add a patch").click()
    tab.until(lambda patches: len(patches) == 2)
    shown.nth(1).wait_for()
    state = msgspec.json.decode(tab.page.request.get(f"{tab.url}/state").body(), type=State)
    tab.page.locator("[data-revision]", has_text=str(state.revision)).wait_for()  # told here as well
    assert shapes.count() == 1
    tab.page.mouse.up()
    shapes.nth(1).wait_for()
