"""The page's camera does what the servers do with a view, and its gestures keep hold of what they took."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page
from starlette.applications import Starlette
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from support.pages.browser import browser, browser_page, serving
from support.scenes.arbitrary import plain_scene
from tolerances import CAMERA_PIXELS, ROUNDING
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.protocol.description.scene import View
from volsplat.protocol.description.view_rotation import Quaternion, named_view
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, grid_on_screen

__all__ = ["browser", "browser_page"]

Case = dict[str, Any]
Point = tuple[float, float]

CASES = 100
HALF_THE_SPHERE = math.sqrt(0.5)  # of its radius: within this the track-ball is a sphere


def random_case(draw: random.Random) -> Case:
    """A view of a volume with any matrix, two points of its picture and one of its grid."""
    width, height = draw.randint(1, 4000), draw.randint(1, 4000)
    return {
        "volume": random_volume(draw),
        "size": {"width": width, "height": height},
        "view": {
            "rotation": random_rotation(draw),
            "zoom": 2 ** draw.uniform(-5, 7),
            "center": [draw.uniform(0, 500) for _ in range(3)],
        },
        "from": [draw.uniform(0, width), draw.uniform(0, height)],
        "to": [draw.uniform(0, width), draw.uniform(0, height)],
        "index": [draw.randint(0, 500) for _ in range(3)],
        "factor": 2 ** draw.uniform(-1, 1),
    }


def random_volume(draw: random.Random) -> Case:
    while True:
        rows = [[draw.gauss(0, 1) * 10 ** draw.uniform(-2, 2) for _ in range(3)] for _ in range(3)]
        geometry = Geometry(
            dims=(draw.randint(1, 500), draw.randint(1, 500), draw.randint(1, 500)), index_to_physical=matrix(rows)
        )
        # Flatter voxels than any scanner's only test the rounding of the inverse.
        if geometry.reference_spacing > 0.1 * max(geometry.spacing):
            return {
                "dims": geometry.dims,
                "index_to_upright": rows,
                "reference_spacing": geometry.reference_spacing,
            }


def random_rotation(draw: random.Random) -> Quaternion:
    x, y, z, w = (draw.gauss(0, 1) for _ in range(4))
    length = math.hypot(x, y, z, w)
    return (x / length, y / length, z / length, w / length)


def matrix(rows: list[list[float]]) -> Matrix:
    a, b, c = ((row[0], row[1], row[2]) for row in rows)
    return (a, b, c)


def vector(parts: list[float]) -> Vector:
    return (parts[0], parts[1], parts[2])


def geometry_of(case: Case) -> Geometry:
    volume = case["volume"]
    return Geometry(dims=volume["dims"], index_to_physical=matrix(volume["index_to_upright"]))


def position(case: Case, view: Case, index: Vector) -> Vector:
    """Where the servers put a grid point, which may lie between voxels: x right, y down, depth."""
    scene = plain_scene(
        view=View(rotation=view["rotation"], zoom=view["zoom"], center=vector(view["center"])),
        size=(case["size"]["width"], case["size"]["height"]),
    )
    grid = grid_on_screen(scene, geometry_of(case))
    whole = (math.floor(index[0]), math.floor(index[1]), math.floor(index[2]))
    within = matrices.applied(grid.pixels_per_index, matrices.minus(index, vector([float(n) for n in whole])))
    doubled = (2 * whole[0], 2 * whole[1], 2 * whole[2])
    x, y = (dda.at_half_indices(doubled) / FIXED_ONE for dda in (grid.x, grid.y))
    z = grid.origin[2] + matrices.dot(grid.pixels_per_index[2], vector([float(n) for n in whole]))
    return (x + within[0], y + within[1], z + within[2])


def grid_point_under(case: Case, at: Point) -> Vector:
    """The grid point that a view shows at a pixel, as deep as its centre."""
    view = case["view"]
    x, y, z = position(case, view, vector(view["center"]))
    turn = matrices.rotation_from_quaternion(view["rotation"])
    scale = view["zoom"] / case["volume"]["reference_spacing"]
    upright = matrices.times(matrices.product(turn, matrix(case["volume"]["index_to_upright"])), scale)
    step = matrices.applied(matrices.inverse(upright), (at[0] - x, -(at[1] - y), 0.0))
    return matrices.plus(vector(view["center"]), step)


@pytest.fixture
def modules(browser_page: Page) -> Iterator[Page]:
    """A tab from which the page's modules can be imported."""
    with serving(Starlette(routes=[Mount("/static", StaticFiles(directory=STATIC))])) as url:
        browser_page.goto(f"{url}/static/theme.css")
        yield browser_page


@pytest.fixture
def cases() -> list[Case]:
    draw = random.Random(1989)
    return [random_case(draw) for _ in range(CASES)]


_OF_EACH = """async (cases) => {
    const camera = await import("/static/viewport/camera.js"), rotation = await import("/static/viewport/rotation.js");
    return cases.map(({ volume, size, view, from, to, index, factor }) => {
        const grid = new camera.Grid(volume);
        return (EXPRESSION);
    });
}"""


def of_each(modules: Page, cases: list[Case], expression: str) -> list[Any]:
    """The value of a JavaScript expression of `camera`, `rotation` and the names of a case, for each case."""
    answers: list[Any] = modules.evaluate(_OF_EACH.replace("EXPRESSION", expression), cases)
    return answers


def test_a_grid_point_lies_where_the_servers_put_it(modules: Page, cases: list[Case]) -> None:
    places = of_each(modules, cases, "new camera.Projection(view, grid, size).at(index)")
    for case, place in zip(cases, places, strict=True):
        assert place == pytest.approx(position(case, case["view"], vector(case["index"])), abs=CAMERA_PIXELS)


def test_axis_views_are_those_of_the_command(modules: Page, cases: list[Case]) -> None:
    [views] = of_each(modules, cases[:1], "rotation.AXIS_VIEWS.map((name) => [name, rotation.namedView(name)])")
    assert [name for name, _ in views] == ["front", "back", "left", "right", "top", "bottom"]
    for name, rotation in views:
        assert rotation == pytest.approx(named_view(name), abs=ROUNDING)


def test_turning_keeps_the_point_of_the_sphere_under_the_pointer(modules: Page, cases: list[Case]) -> None:
    for case in cases:
        for end in ("from", "to"):
            case[end] = within_the_sphere(case["size"], case[end])
    for case, view in zip(cases, of_each(modules, cases, "camera.turned(view, size, from, to)"), strict=True):
        old, new = (matrices.rotation_from_quaternion(v["rotation"]) for v in (case["view"], view))
        taken = matrices.applied(matrices.transposed(old), sphere_point(case["size"], case["from"]))
        assert matrices.applied(new, taken) == pytest.approx(sphere_point(case["size"], case["to"]), abs=ROUNDING)
        assert (view["zoom"], view["center"]) == (case["view"]["zoom"], case["view"]["center"])


def within_the_sphere(size: Case, at: list[float]) -> list[float]:
    """The point, drawn towards the middle until the track-ball is a sphere there."""
    middle = [(size["width"] - 1) / 2, (size["height"] - 1) / 2]
    out = math.dist(at, middle) / (min(size["width"], size["height"]) / 2)
    share = min(1.0, 0.99 * HALF_THE_SPHERE / out)
    return [m + (part - m) * share for m, part in zip(middle, at, strict=True)]


def sphere_point(size: Case, at: list[float]) -> Vector:
    radius = min(size["width"], size["height"]) / 2
    x, y = (at[0] - (size["width"] - 1) / 2) / radius, ((size["height"] - 1) / 2 - at[1]) / radius
    return (x, y, math.sqrt(1 - x * x - y * y))


def test_turning_anywhere_keeps_a_unit_rotation(modules: Page, cases: list[Case]) -> None:
    for view in of_each(modules, cases, "camera.turned(view, size, from, to)"):
        assert math.hypot(*view["rotation"]) == pytest.approx(1, abs=ROUNDING)


def test_rolling_turns_about_the_middle_with_the_pointer(modules: Page, cases: list[Case]) -> None:
    for case, view in zip(cases, of_each(modules, cases, "camera.rolled(view, size, from, to)"), strict=True):
        middle = ((case["size"]["width"] - 1) / 2, (case["size"]["height"] - 1) / 2)
        (x, y), (tx, ty) = ((end[0] - middle[0], end[1] - middle[1]) for end in (case["from"], case["to"]))
        before = position(case, case["view"], grid_point_under(case, case["from"]))
        after = position(case, view, grid_point_under(case, case["from"]))
        stretch = math.hypot(tx, ty) / math.hypot(x, y)
        expected = (middle[0] + tx / stretch, middle[1] + ty / stretch)
        assert before[:2] == pytest.approx(tuple(case["from"]), abs=CAMERA_PIXELS)
        assert after[:2] == pytest.approx(expected, abs=CAMERA_PIXELS)


def test_panning_takes_a_grid_point_along(modules: Page, cases: list[Case]) -> None:
    for case, view in zip(cases, of_each(modules, cases, "camera.panned(view, grid, from, to)"), strict=True):
        x, y, _ = position(case, view, grid_point_under(case, case["from"]))
        assert (x, y) == pytest.approx(tuple(case["to"]), abs=CAMERA_PIXELS)


def test_zooming_keeps_what_lies_under_the_pointer(modules: Page, cases: list[Case]) -> None:
    views = of_each(modules, cases, "camera.zoomed(view, grid, size, from, factor)")
    for case, view in zip(cases, views, strict=True):
        assert view["zoom"] == pytest.approx(case["view"]["zoom"] * case["factor"], rel=ROUNDING)
        x, y, _ = position(case, view, grid_point_under(case, case["from"]))
        assert (x, y) == pytest.approx(tuple(case["from"]), abs=CAMERA_PIXELS)


@pytest.mark.parametrize(("factor", "end"), [(1e9, 256), (1e-9, 1 / 64)])
def test_zooming_ends_where_the_scene_does(modules: Page, cases: list[Case], factor: float, end: float) -> None:
    for case in cases:
        case["factor"] = factor
    views = of_each(modules, cases, "camera.zoomed(view, grid, size, from, factor)")
    assert {view["zoom"] for view in views} == {end}


def test_two_fingers_keep_what_lies_between_them(modules: Page, cases: list[Case]) -> None:
    pinch = "camera.pinched(view, grid, size, [from, [from[0] + 100, from[1]]], [to, [to[0], to[1] + 150]])"
    for case, view in zip(cases, of_each(modules, cases, pinch), strict=True):
        assert view["zoom"] == pytest.approx(min(256, 1.5 * case["view"]["zoom"]), rel=ROUNDING)
        x, y, _ = position(case, view, grid_point_under(case, (case["from"][0] + 50, case["from"][1])))
        assert (x, y) == pytest.approx((case["to"][0], case["to"][1] + 75), abs=CAMERA_PIXELS)


def test_scale_bar_has_the_longest_round_length(modules: Page) -> None:
    wanted = [10 ** random.Random(n).uniform(-6, 6) for n in range(CASES)]
    lengths = modules.evaluate(
        """async (wanted) => {
            const { roundLength } = await import("/static/viewport/scale_bar.js");
            return wanted.map(roundLength);
        }""",
        wanted,
    )
    for most, length in zip(wanted, lengths, strict=True):
        assert f"{length:.0e}"[0] in "125"
        assert float(f"{length:.0e}") == length
        assert length <= most < 2.5 * length
