"""What a viewport gets and may say, from the real command with real servers."""

import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import torch
from PIL import Image as PillowImage

from support.pages.viewed import Shown, Viewed, Viewport, view, viewed, volume
from support.patience import PATIENCE
from volsplat.bench.slow_link import slow_link
from volsplat.client.image.image_file import coded
from volsplat.client.scene.resized import sized
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import PaperStep
from volsplat.protocol.description.scene import Refine
from volsplat.protocol.description.volume import Index

__all__ = ["view", "volume"]

SIDE = 96  # pixels of the image


@pytest.fixture(scope="module")
def phantom() -> tuple[str, Index]:
    return "shells", (24, 20, 28)


@pytest.fixture
def viewport(view: Viewed) -> Iterator[Viewport]:
    with view.viewport("a") as opened:
        opened.says("size", width=SIDE, height=SIDE)
        opened.last_picture(width=SIDE)
        yield opened


def turned(angle: float, *, event: int, settled: bool) -> dict[str, object]:
    rotation = [math.sin(angle / 2), 0.0, 0.0, math.cos(angle / 2)]
    view = {"rotation": rotation, "zoom": 2.0, "center": [12.0, 10.0, 14.0], "width": SIDE, "height": SIDE}
    return {**view, "settled": settled, "event": event}


def pixels(picture: Shown) -> torch.Tensor:
    image = PillowImage.open(io.BytesIO(picture.data)).convert("RGB")
    return torch.frombuffer(bytearray(image.tobytes()), dtype=torch.uint8).reshape(image.height, image.width, 3)


def test_a_still_image_refines_through_the_steps_to_a_lossless_one(view: Viewed, volume: Path) -> None:
    with view.viewport("steps") as viewport:
        viewport.says("size", width=SIDE + 7, height=SIDE)
        # Those before are of the scene that the page began with.
        shown = [picture for picture in viewport.last_picture(width=SIDE + 7) if picture.header["width"] == SIDE + 7]
    finished = [picture.header["step"] for picture in shown if picture.header["complete"]]
    assert finished == sorted(finished) and finished[-1] == "F"
    numbers = [picture.header["number"] for picture in shown]
    assert numbers == sorted(set(numbers))
    with SingleProcess(volume) as single:
        first = msgspec.structs.replace(single.volume.default_scene(), refine=Refine(lit_from=PaperStep.C))
        scene = sized(single.volume.fitted_to_turn(first), width=SIDE + 7, height=SIDE)
        expected = coded(single.finish(scene).published.pixels, scene.image.background)
    assert shown[-1].data.startswith(b"\x89PNG")
    assert torch.equal(pixels(shown[-1]), torch.from_numpy(expected))


def test_the_volume_and_the_scene_are_told_first(view: Viewed) -> None:
    with view.viewport("first") as viewport:
        told = viewport.hears(), viewport.hears()
    assert [message["type"] for message in told if isinstance(message, dict)] == ["volume", "scene"]
    assert isinstance(told[0], dict) and told[0]["dims"] == [24, 20, 28]


def test_of_many_moves_the_newest_is_drawn_and_its_event_comes_back(viewport: Viewport) -> None:
    moves = 120
    for event in range(1, moves):
        viewport.says("view", **turned(event / 20, event=event, settled=False))
    viewport.says("view", **turned(moves / 20, event=moves, settled=True))
    shown = viewport.last_picture(event=moves)
    events = [picture.header["event"] for picture in shown]
    assert events == sorted(events) and events[-1] == moves
    assert len(shown) < moves
    assert shown[-1].header["view"]["rotation"] == pytest.approx(turned(moves / 20, event=0, settled=True)["rotation"])


def test_no_more_than_two_pictures_are_under_way(viewport: Viewport) -> None:
    for event in range(1, 30):
        viewport.says("view", **turned(event / 9, event=event, settled=True))
    for _ in range(2):
        while not isinstance(viewport.hears(), Shown):
            pass
    with pytest.raises(TimeoutError):
        while True:
            assert not isinstance(viewport.hears(timeout=1), Shown)
    viewport.says("shown", number=10**9)
    assert viewport.last_picture(event=29)


def test_through_a_slow_line_the_rate_falls_and_the_newest_still_arrives(view: Viewed) -> None:
    moves = 60
    with slow_link(view.port, bits_per_second=1e6, round_trip=0.04) as port, view.viewport("far", port) as viewport:
        viewport.says("size", width=SIDE, height=SIDE)
        viewport.last_picture()
        for event in range(1, moves):
            viewport.says("view", **turned(event / 20, event=event, settled=False))
        viewport.says("view", **turned(moves / 20, event=moves, settled=True))
        shown = viewport.last_picture(event=moves)
    # What was on its way may come before the newest, no more: no queue of old pictures has grown.
    assert len(shown) < moves / 2
    assert shown[-1].header["event"] == moves


def test_a_larger_window_shows_the_same_part_of_the_volume(viewport: Viewport) -> None:
    viewport.says("view", **turned(0.2, event=1, settled=True))
    viewport.says("size", width=4 * SIDE, height=2 * SIDE)
    shown = viewport.last_picture(event=1)[-1].header
    while shown["width"] != 4 * SIDE:
        shown = viewport.last_picture(event=1)[-1].header
    assert shown["view"]["zoom"] == 2 * 2.0


def size_told(viewport: Viewport, width: int) -> dict[str, Any]:
    """The first scene told whose image is so wide."""
    while (told := viewport.message("scene"))["width"] != width:
        pass
    return told


def test_the_image_has_the_size_of_the_window_that_was_used_last(view: Viewed, viewport: Viewport) -> None:
    viewport.says("view", **turned(0.2, event=1, settled=True))
    with view.viewport("small") as small:
        small.says("size", width=SIDE // 2, height=SIDE // 2)
        assert size_told(small, SIDE // 2)["view"]["zoom"] == 1.0
        size_told(viewport, SIDE // 2)
        viewport.says("view", **turned(0.3, event=2, settled=True))  # as seen before it heard of the small one
        assert size_told(small, SIDE)["view"]["zoom"] == 2.0
        size_told(viewport, SIDE)
        small.says("undo")
        assert size_told(viewport, SIDE // 2)["view"]["zoom"] == 1.0
    assert size_told(viewport, SIDE)["view"]["zoom"] == 2.0  # the small one is closed


def test_a_window_hears_of_its_images_size_while_hands_are_at_the_scene(view: Viewed, viewport: Viewport) -> None:
    viewport.says("view", **turned(0.1, event=1, settled=False))
    with view.viewport("small") as small:
        small.says("size", width=SIDE // 2, height=SIDE // 2)
        assert not size_told(small, SIDE // 2)["settled"]
        size_told(viewport, SIDE // 2)
        viewport.says("view", **turned(0.2, event=2, settled=False))
        assert not size_told(viewport, SIDE)["settled"]


def test_what_a_closed_window_was_at_is_settled(view: Viewed, viewport: Viewport) -> None:
    with view.viewport("closing") as closing:
        closing.says("view", **turned(0.4, event=1, settled=False))
        while viewport.message("scene")["settled"]:
            pass
    while not viewport.message("scene")["settled"]:
        pass


def test_what_a_hand_is_at_is_told_to_the_other_windows_and_to_its_own_once_it_is_settled(
    view: Viewed, viewport: Viewport
) -> None:
    with view.viewport("watching") as watching:
        watching.message("scene")
        for event in range(1, 4):
            viewport.says("view", **turned(event / 9, event=event, settled=False))
        viewport.says("view", **turned(0.5, event=4, settled=True))
        told = [watching.message("scene")["settled"] for _ in range(4)]
        own = viewport.message("scene")
    assert told == [False, False, False, True]
    assert own["settled"] and own["view"]["rotation"] == pytest.approx(turned(0.5, event=4, settled=True)["rotation"])


def test_two_tabs_show_one_scene(view: Viewed, viewport: Viewport) -> None:
    with view.viewport("b") as other:
        other.last_picture()
        viewport.says("bounds", low=[2, 3, 4], high=[20, 18, 22], settled=True, event=1)
        while (heard := other.message("scene"))["bounds"] != {"low": [2, 3, 4], "high": [20, 18, 22]}:
            pass
        assert heard["by"] == "a"
        other.says("undo")
        while viewport.message("scene")["bounds"] != {"low": [0, 0, 0], "high": [24, 20, 28]}:
            pass
        other.says("redo")
        while viewport.message("scene")["bounds"]["low"] != [2, 3, 4]:
            pass
        viewport.says("undo")
        while other.message("scene")["bounds"]["low"] != [0, 0, 0]:
            pass


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"type":"view"}',
        '{"type":"nothing"}',
        '{"type":"size","width":0,"height":5}',
        '{"type":"size","width":1e9,"height":5}',
        '{"type":"view","rotation":[0,0,0,0],"zoom":1,"center":[0,0,0],"width":9,"height":9,"settled":true,"event":1}',
        '{"type":"view","rotation":[0,0,0,1],"zoom":1e9,"center":[0,0,0],"width":9,"height":9,"settled":true,"event":1}',
        '{"type":"view","rotation":[0,0,0,1],"zoom":1,"center":[0,0,0],"width":0,"height":9,"settled":true,"event":1}',
        '{"type":"bounds","low":[5,5,5],"high":[5,6,6],"settled":true,"event":1}',
        '{"type":"bounds","low":[0,0,0],"high":[999,6,6],"settled":true,"event":1}',
    ],
)
def test_what_cannot_be_is_told_in_words_and_changes_nothing(view: Viewed, viewport: Viewport, text: str) -> None:
    with view.viewport("watching") as watching:
        before = watching.message("scene")
        viewport.says_text(text)
        trouble = viewport.message("trouble")
        assert trouble["text"] and "\n" not in trouble["text"]
        viewport.says("bounds", low=before["bounds"]["low"], high=before["bounds"]["high"], settled=True, event=1)
        after = watching.message("scene")
    for key in ("view", "bounds", "width", "height"):
        assert after[key] == before[key]


def test_a_lost_server_is_told_and_all_is_drawn_by_the_others(volume: Path) -> None:
    with viewed(volume.parent, volume, "--workers", "2") as view, view.viewport("a") as viewport:
        viewport.says("size", width=SIDE, height=SIDE)
        whole = viewport.last_picture()[-1]
        assert whole.header["missing"] == []
        view.mapshade_servers()[0].kill()
        viewport.look_until_told("others take over")
        viewport.says("view", **turned(0.3, event=1, settled=True))
        again = viewport.last_picture(event=1)[-1]
        assert again.header["missing"] == [] and pixels(again).any()


def test_the_command_ends_by_itself_when_no_page_is_open(volume: Path) -> None:
    with viewed(volume.parent, volume, "--workers", "1", "--grace", "0.5") as view:
        assert view.process.wait(PATIENCE) == 0
    assert any("no page was open" in line for line in view.said)
