"""Slices are turned as the views that look straight at them: nobody is mirrored, however a file lies."""

from __future__ import annotations

from itertools import permutations, product
from typing import TYPE_CHECKING, Any

import pytest
from starlette.applications import Starlette
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from support.pages.browser import browser, browser_page, serving
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.protocol.description.view_rotation import named_view
from volsplat.protocol.geometry import matrices

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page"]

SIDES = {name: name for name in ("front", "back", "left", "right", "top", "bottom")}
SPACINGS = (0.5, 1.0, 3.0)
LAID_OUT = """async ([url, volumes]) => {
    const { sliceLayouts } = await import(url);
    return volumes.map((volume) => sliceLayouts(volume).map((layout) => ({
        view: layout.view, sides: layout.sides, steps: layout.steps, letters: layout.letters,
        back: layout.indexAt(layout.at(2, 5)),
    })));
}"""


def told(columns: list[list[float]]) -> dict[str, Any]:
    rows = [[column[n] for column in columns] for n in range(3)]
    return {"dims": [4, 5, 6], "index_to_upright": rows, "reference_spacing": 1.0, "sides": SIDES}


def laid_out(page: Page, volumes: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    application = Starlette(routes=[Mount("/static", StaticFiles(directory=STATIC))])
    with serving(application) as url:
        page.goto(f"{url}/static/page.css")
        found: list[list[dict[str, Any]]] = page.evaluate(LAID_OUT, [f"{url}/static/slices/slice_layout.js", volumes])
        return found


def test_in_all_48_ways_to_store_a_volume_a_slice_is_seen_as_its_view_sees_it(browser_page: Page) -> None:
    ways = list(product(permutations(range(3)), product((-1, 1), repeat=3)))
    volumes = [
        told([[sign * SPACINGS[n] * (n == axis) for n in range(3)] for axis, sign in zip(order, signs, strict=True)])
        for order, signs in ways
    ]
    for volume, layouts in zip(volumes, laid_out(browser_page, volumes), strict=True):
        assert {layout["view"] for layout in layouts} == {"left", "front", "bottom"}
        for layout in layouts:
            turn = matrices.rotation_from_quaternion(named_view(layout["view"]))
            for side, step in zip(layout["sides"], layout["steps"], strict=True):
                column = tuple(row[side] for row in volume["index_to_upright"])
                right, up, _ = matrices.applied(turn, column)
                assert step == pytest.approx([right, up])
            assert layout["back"] == pytest.approx([2, 5])
            left, bottom = {"left": ("front", "bottom"), "front": ("right", "bottom"), "bottom": ("right", "back")}[
                layout["view"]
            ]
            assert (layout["letters"]["left"], layout["letters"]["bottom"]) == (left, bottom)


def test_a_skew_grid_keeps_its_lengths_and_angles(browser_page: Page) -> None:
    columns = [[1.0, 0.1, 0.0], [0.5, 2.0, 0.2], [0.1, 0.3, 1.5]]
    for layout in laid_out(browser_page, [told(columns)])[0]:
        first, second = (columns[side] for side in layout["sides"])
        (ax, ay), (bx, by) = layout["steps"]
        dot = sum(one * other for one, other in zip(first, second, strict=True))
        assert ax * bx + ay * by == pytest.approx(dot)
        assert ax * ax + ay * ay == pytest.approx(sum(part * part for part in first))
        assert bx * bx + by * by == pytest.approx(sum(part * part for part in second))
