"""The page in a real Firefox: pictures come, the hand turns the volume, panels change it, and the console is quiet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from support.pages.firefox import Firefox, Place, running_firefox
from support.pages.viewed import Viewed
from volsplat.bench.page_drag import REFINED

_VIEW = "() => window.volsplatViewport.view"
_PICTURE = "() => window.volsplatViewport.canvas.toDataURL()"
_FINGERS_APART = 60.0  # pixels


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Firefox]:
    with running_firefox(tmp_path_factory.mktemp("firefox")) as firefox:
        yield firefox


@pytest.fixture
def firefox(started: Firefox, view: Viewed) -> Iterator[Firefox]:
    """With the page, refined to the end. It is loaded once, by the first test."""
    started.errors.clear()
    if not started.finds("() => 'volsplatViewport' in window"):
        opened(started, view)
    yield started
    assert not started.errors


def opened(firefox: Firefox, view: Viewed) -> None:
    firefox.opens(view.url)
    firefox.waits_for(REFINED, "refined to the end")


def after(firefox: Firefox, act: Callable[[], object]) -> tuple[dict[str, Any], str]:
    """The view and the picture once the scene that an act makes is refined to the end."""
    revision = firefox.finds("() => window.volsplatViewport.log.at(-1).revision")
    act()
    firefox.waits_for(
        f"() => (({{ last, revision }}) => last && revision > {revision})(window.volsplatViewport.log.at(-1))",
        "drawn after what was done",
    )
    return firefox.finds(_VIEW), firefox.finds(_PICTURE)


def beside(place: Place, right: float, down: float) -> Place:
    x, y = place
    return x + right, y + down


# What each changes of the view, and how it is done from a place on the picture.
HANDS: dict[str, tuple[str, Callable[[Firefox, Place], None]]] = {
    "left drag": ("rotation", lambda firefox, at: firefox.drags(at, beside(at, 60, -30))),
    "right drag": ("center", lambda firefox, at: firefox.drags(at, beside(at, 40, 25), button=2)),
    "middle drag": ("center", lambda firefox, at: firefox.drags(at, beside(at, -30, 25), button=1)),
    "one finger": ("rotation", lambda firefox, at: firefox.touches((at, beside(at, -50, 40)))),
    "arrow key": ("rotation", lambda firefox, _: firefox.presses("\ue014")),
}
ZOOMS: dict[str, Callable[[Firefox, Place], None]] = {
    "wheel": lambda firefox, at: firefox.wheels(at, -120),
    "two fingers": lambda firefox, at: firefox.touches(
        (at, beside(at, -_FINGERS_APART, 0)), (beside(at, 30, 0), beside(at, 30 + _FINGERS_APART, 0))
    ),
}


@pytest.mark.parametrize("hand", HANDS)
def test_the_hand_turns_and_moves_the_volume(firefox: Firefox, hand: str) -> None:
    changed, act = HANDS[hand]
    before, picture = firefox.finds(_VIEW), firefox.finds(_PICTURE)
    now, drawn = after(firefox, lambda: act(firefox, bare_place(firefox)))
    assert [key for key in before if now[key] != before[key]] == [changed]
    assert drawn != picture


@pytest.mark.parametrize("hand", ZOOMS)
def test_the_wheel_and_two_fingers_zoom(firefox: Firefox, hand: str) -> None:
    before, picture = firefox.finds(_VIEW), firefox.finds(_PICTURE)
    now, drawn = after(firefox, lambda: ZOOMS[hand](firefox, bare_place(firefox)))
    assert now["zoom"] > before["zoom"]
    assert now["rotation"] == before["rotation"]
    assert drawn != picture


def bare_place(firefox: Firefox) -> Place:
    """Of the picture, beside the handles, which stand at its middle and at its sides."""
    return beside(firefox.middle_of(".vs-picture"), 30, 45)


def test_a_slider_of_a_panel_changes_the_picture(firefox: Firefox) -> None:
    slider = "[role=slider][aria-label='specular power']"
    number = f"() => Number(document.querySelector(`{slider}`).ariaValueNow)"
    at, before, picture = firefox.middle_of(slider), firefox.finds(number), firefox.finds(_PICTURE)
    view, drawn = after(firefox, lambda: firefox.drags(at, beside(at, -40, 0)))
    assert firefox.finds(number) < before
    assert drawn != picture
    assert view == firefox.finds(_VIEW)


def test_pictures_are_drawn_where_the_browser_decodes_them_from_files_alone(firefox: Firefox, view: Viewed) -> None:
    """As older ones of Firefox and Safari do."""
    shown = firefox.finds(_PICTURE)
    with firefox.begins_with("() => { delete window.ImageDecoder; }"):
        opened(firefox, view)
    assert not firefox.finds("() => 'ImageDecoder' in window")
    assert firefox.finds(_PICTURE) == shown
