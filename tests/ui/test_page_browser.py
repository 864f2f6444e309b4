"""The whole page, from the real command, used in a real browser."""

from __future__ import annotations

import io
import math
import re
import time
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import psutil
import pytest
import torch
from PIL import Image as PillowImage

from support.files.opened import read_whole
from support.pages import patient_http
from support.pages.browser import browser, browser_page
from support.pages.hand import under_a_hand
from support.pages.page_tab import after, canvas, drag, fresh_page, opened, page, pixels_of, save
from support.pages.tables_tab import box, until
from support.pages.viewed import Viewed, viewed
from support.patience import PATIENCE, wait_until
from support.programs.server_processes import is_server
from volsplat.bench.page_drag import REFINED, Drag, ShownPicture, check_turned, dragged, show_in
from volsplat.bench.slow_link import slow_link
from volsplat.client.image.image_file import read_scene
from volsplat.client.scene.scene_file import scene_from_toml
from volsplat.client.ui.viewport.under_way import LEAST, MOST
from volsplat.protocol.text.errors import VolsplatError

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

IMAGE = 512
FAR = 0.4  # seconds a round trip
VALUE = "(label) => document.querySelector(`input[aria-label='${label}']`).value"
ENDS = [(end, axis) for axis in "ijk" for end in ("lowest", "end of")]

__all__ = ["browser", "browser_page", "fresh_page", "page"]


def test_the_page_shows_the_volume_and_every_part_of_the_scene(page: Page) -> None:
    assert canvas(page)[..., :3].any()
    for words in ("Emitted", "Reflected", "Opacity", "Modulation", "Shading", "View", "Bounds"):
        assert page.get_by_text(words, exact=True).first.is_visible()


def test_a_picture_of_the_scene_comes_before_any_script_and_the_viewport_takes_it_over(
    view: Viewed, browser_page: Page
) -> None:
    from playwright.sync_api import expect

    browser_page.route(re.compile(r"\.m?js"), lambda route: route.abort())
    browser_page.goto(view.url)
    image = browser_page.locator(".vs-early img")
    browser_page.wait_for_function(
        "() => { const i = document.querySelector('.vs-early img'); return i?.complete && i.naturalWidth > 0; }"
    )
    shown = PillowImage.open(io.BytesIO(image.screenshot())).convert("L")
    assert max(shown.tobytes()) > 50, "it is black"
    assert browser_page.locator(".vs-view").count() == 0
    where = image.bounding_box()
    word = browser_page.locator("#esm-fallback").evaluate(
        "(word) => [getComputedStyle(word).animationDelay, getComputedStyle(word, '::after').content]"
    )
    assert word[0] == "5s" and "have not run yet" in word[1], "a slow line is taken for a browser that is too old"

    browser_page.unroute_all()
    opened(browser_page, view.url)
    expect(image).to_have_count(0)
    there = browser_page.locator(".vs-picture").bounding_box()
    assert where is not None and there is not None
    assert all(abs(where[side] - there[side]) <= 8 for side in ("x", "y", "width", "height"))


def test_dragging_turns_the_volume_and_nothing_stale_is_shown(page: Page) -> None:
    before = canvas(page)
    turned = after(page, lambda: drag(page, 120, 40))
    assert not torch.equal(before, turned)
    numbers = page.evaluate("() => window.volsplatViewport.log.map(p => p.number)")
    assert numbers == sorted(set(numbers))


def test_what_is_known_of_the_volume_and_of_the_servers_is_at_hand(page: Page) -> None:
    from playwright.sync_api import expect

    page.get_by_role("button", name="about this volume").click()
    known = page.locator(".vs-information")
    expect(known).to_contain_text("24 x 32 x 28 = 21504 voxels")
    expect(known).to_contain_text("gradient strength: 0 becomes 0")
    page.keyboard.press("Escape")
    expect(known).to_be_hidden()
    expect(page.locator(".vs-servers-head")).to_contain_text(
        re.compile(r"2 map/shade \+ 1 splat · step F in [0-9.]+ m?s")
    )


def test_the_value_under_the_pointer_is_the_files_and_marked_in_the_tables(page: Page, volume: Path) -> None:
    from playwright.sync_api import expect

    line = page.locator('section[aria-label="Opacity"] [data-part="told"]')
    expect(line).to_have_attribute("display", "none")
    box = page.locator(".vs-picture").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(line).to_have_attribute("display", "inline")
    value = page.locator(".vs-value")
    expect(value).to_have_text(re.compile(r"^value -?[0-9.e-]+ · .* at \([0-9, ]+\)$"))  # and not ≈
    shown = (value.text_content() or "").split()
    i, j, k = map(int, re.findall("[0-9]+", " ".join(shown[-3:])))
    own = read_whole(volume)[k, j, i]
    assert own.dtype.type(shown[1]) == own
    page.get_by_text("Tables", exact=True).hover()
    expect(line).to_have_attribute("display", "none")


def test_the_bars_under_the_opacity_are_tinted_where_reflected_light_is_by_the_same_field(page: Page) -> None:
    from playwright.sync_api import expect

    tinted = page.locator('section[aria-label="Opacity"] .vs-tinted')
    expect(tinted).to_have_count(1)
    for control, count in (
        (page.get_by_role("radio", name="Reflected by gradient strength"), 0),
        (page.get_by_role("radio", name="Reflected by value"), 1),
        (page.get_by_role("switch", name="diffuse"), 1),
        (page.get_by_role("switch", name="specular"), 0),  # now nothing is reflected
        (page.get_by_role("switch", name="diffuse"), 1),
        (page.get_by_role("switch", name="specular"), 1),
    ):
        control.click()
        expect(tinted).to_have_count(count)
    assert page.locator(".vs-tinted").count() == 1


def test_the_shift_moves_what_is_seen_where_a_table_is_by_density(page: Page) -> None:
    from playwright.sync_api import expect

    before = canvas(page)
    shift = page.get_by_label("shift of all tables by value")
    box = shift.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def shifted() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + box["width"] / 4, y, steps=6)
        page.mouse.up()

    assert not torch.equal(after(page, shifted), before)
    undo = page.get_by_label("undo", exact=True)
    undo.click()
    until(page, lambda: torch.equal(canvas(page), before))
    for table in ("Emitted", "Reflected", "Opacity"):
        expect(shift).to_be_enabled()
        page.get_by_role("radio", name=f"{table} by gradient strength").click()
    expect(shift).to_be_disabled()
    for _ in range(3):
        undo.click()
    expect(shift).to_be_enabled()


def test_reloading_the_page_brings_back_what_was_seen(page: Page) -> None:
    turned = after(page, lambda: drag(page, -80, 30))
    page.reload()
    page.wait_for_function(REFINED)
    assert torch.equal(canvas(page), turned)


def test_two_tabs_stay_in_step(view: Viewed, page: Page) -> None:
    other = page.context.new_page()
    opened(other, view.url)
    number = other.evaluate("() => window.volsplatViewport.log.at(-1).number")
    after(page, lambda: drag(page, 60, 60))
    other.wait_for_function(
        f"() => {{ const p = window.volsplatViewport?.log.at(-1); return p?.last && p.number > {number}; }}"
    )
    assert torch.equal(canvas(other), canvas(page))


def test_the_saved_image_is_what_is_seen_and_holds_its_scene(page: Page, volume: Path, tmp_path: Path) -> None:
    path = tmp_path / "saved.png"
    path.write_bytes(save(page, "image as PNG"))
    saved = pixels_of(path.read_bytes())
    assert torch.equal(saved, canvas(page))
    scene = read_scene(path)
    toml = save(page, "scene as TOML").decode()
    assert scene_from_toml(toml, scene, "saved") == scene
    assert (scene.image.height, scene.image.width) == saved.shape[:2]


def test_what_is_saved_is_fetched_by_its_address_which_opens_for_this_browser_alone(view: Viewed, page: Page) -> None:
    page.get_by_role("button", name="save").click()
    with page.expect_download() as download:
        page.get_by_text("image as PNG").click()
    url = download.value.url
    assert url.startswith(f"http://127.0.0.1:{view.port}/")
    data = download.value.path().read_bytes()
    rest = patient_http.get(url, headers={"Cookie": view.cookie, "Range": "bytes=100-"})
    assert (rest.status_code, rest.content) == (206, data[100:])  # as of a line that was cut
    assert patient_http.get(url).status_code == 403
    assert patient_http.get(f"{url}x", headers={"Cookie": view.cookie}).status_code == 404


def test_a_scene_file_is_opened_and_a_bad_one_is_told_and_changes_nothing(page: Page, tmp_path: Path) -> None:
    scene = save(page, "scene as TOML").decode()
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text(scene.replace('background = "#000000"', 'background = "#204060"'))
    bad.write_text("[image]\nbackground = 7\n")
    page.locator("input[type=file][accept^='.toml']").first.set_input_files(bad)
    page.get_by_text("image.background").wait_for()
    assert save(page, "scene as TOML").decode() == scene
    shown = after(page, lambda: page.locator("input[type=file][accept^='.toml']").first.set_input_files(good))
    assert shown[0, 0, :3].tolist() == [0x20, 0x40, 0x60]
    page.locator(".vs-picture").focus()
    undone = after(page, lambda: page.keyboard.press("Control+z"))
    assert undone[0, 0, :3].tolist() == [0, 0, 0]


def test_a_scene_file_brings_its_very_picture_back_after_tables_view_and_step_were_changed(
    page: Page, tmp_path: Path
) -> None:
    def saved(name: str) -> tuple[Path, torch.Tensor]:
        (tmp_path / name).write_bytes(save(page, "scene as TOML"))
        return tmp_path / name, pixels_of(save(page, "image as PNG"))  # of the newest scene, once it is finished

    def pull_down() -> None:
        place = box(page.locator('section[aria-label="Opacity"] circle[role=slider]').last)
        x, y = place["x"] + place["width"] / 2, place["y"] + place["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y + 15, steps=3)
        page.mouse.up()

    def shows(seen: torch.Tensor) -> None:
        until(page, lambda: torch.equal(canvas(page), seen))

    picker = page.locator("input[type=file][accept^='.toml']").first
    kept = [saved("first.toml")]
    for name, dx, step in (("second.toml", 70, "G"), ("third.toml", -40, "F")):
        after(page, pull_down)
        after(page, partial(drag, page, dx, 20))
        after(page, page.locator('[aria-label="refine to"]').get_by_role("button", name=step, exact=True).click)
        kept.append(saved(name))
        assert not torch.equal(kept[-1][1], kept[-2][1])
    for path, seen in (kept[1], kept[0]):  # of step G and F
        picker.set_input_files(path)
        shows(seen)


def test_a_copied_link_restores_the_scene(view: Viewed, fresh_page: Page) -> None:
    page = fresh_page
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    seen = after(page, lambda: drag(page, 33, -44))
    page.get_by_role("button", name="save").click()
    page.get_by_text("copy a link").click()
    page.get_by_text("copied").wait_for()
    link = page.evaluate("() => navigator.clipboard.readText()")
    assert link.startswith(f"http://127.0.0.1:{view.port}/?scene=") and "token" not in link
    after(page, lambda: drag(page, -99, 10))
    opened(page, link)
    assert torch.equal(canvas(page), seen)
    page.goto(link.replace("volume=head.nrrd", "volume=other.nrrd"))
    page.get_by_text("this link is to a scene of other.nrrd, and head.nrrd is shown; open that first").wait_for()
    assert patient_http.get(link).status_code == 403  # it opens the page to nobody
    page.goto(view.url + "&scene=AAAA")
    page.get_by_text("this link holds no").wait_for()


def test_without_the_token_there_is_one_line_and_nothing_else(view: Viewed, browser_page: Page) -> None:
    for path in ("", "/volsplat/static/viewport/viewport.js", "/_nicegui/client"):
        answer = patient_http.get(f"http://127.0.0.1:{view.port}{path}")
        assert answer.status_code == 403 and "token" in answer.text
    browser_page.goto(f"http://127.0.0.1:{view.port}/")
    assert browser_page.locator("canvas").count() == 0


def test_through_a_slow_line_nothing_stale_is_shown_and_no_more_than_is_under_way_comes_late(view: Viewed) -> None:
    slow = slow_link(view.port, bits_per_second=20e6, round_trip=0.04)
    with slow as port, under_a_hand(view.url.replace(f":{view.port}/", f":{port}/")) as tab:
        show_in(tab, IMAGE)
        moves = dragged(tab, 90)
        whole = [tab.evaluate(VALUE, f"{end} {axis}") for end, axis in ENDS]
        size = tab.evaluate("() => { const p = window.volsplatViewport.log.at(-1); return [p.width, p.height] }")
    assert whole == ["0", "24", "0", "32", "0", "28"], "it was turned, and not cut by a handle"
    assert size == [IMAGE, IMAGE] and sum(moves.drawn_as().values()) == pytest.approx(1.0)
    assert moves.stale() == 0
    events = [event for event, _ in moves.sent]
    shown = [picture.event for picture in moves.shown]
    assert shown[-1] >= events[-1] and shown == sorted(shown)
    # What a line is too slow for is left out, and never queued: only a queue could grow, and would come late.
    last, rests = moves.sent[-1]
    assert len({picture.event for picture in moves.shown if picture.at > rests and picture.event < last}) <= MOST


def test_a_hand_that_turns_nothing_is_no_measurement(volume: Path) -> None:
    with (
        viewed(volume.parent, volume, "--set", "tables.opac.points=[[0.0,0.0],[1.0,0.0]]") as view,
        under_a_hand(view.url) as tab,
        pytest.raises(VolsplatError, match="nothing is seen"),
    ):
        dragged(tab, 10)


def shown(event: int, angle: float, *, zoom: float = 1.0, center: float = 0.0) -> ShownPicture:
    """A picture that contains an event, of a volume that is turned about i."""
    rotation = [math.cos(angle), math.sin(angle), 0.0, 0.0]
    return ShownPicture(event, event, 16.0 * event, "F", 512, 512, 1, rotation, [center, 0.0, 0.0], zoom)


@pytest.mark.parametrize(
    ("second", "cause"),
    [
        (shown(2, 0.1), "do not follow"),
        (shown(2, 0.2, zoom=1.1), "zoomed"),
        (shown(2, 0.2, center=3.0), "moved"),
        (shown(2, 0.2), ""),
    ],
)
def test_each_picture_of_a_drag_must_turn_the_volume_and_do_nothing_else(second: ShownPicture, cause: str) -> None:
    turned = shown(4, 0.4)
    with nullcontext() if not cause else pytest.raises(VolsplatError, match=cause):
        check_turned([shown(1, 0.1), second, shown(2, 0.2), shown(4, 0.4)], turned.rotation)
    with pytest.raises(VolsplatError, match="do not follow"):
        check_turned([shown(1, 0.1), shown(2, 0.2)], turned.rotation)


def test_on_a_far_line_more_than_two_pictures_are_under_way_and_none_is_stale(view: Viewed) -> None:
    """Of two, each is followed by the next a round trip later: in less than that no more than two are shown."""

    def followed_closely(drag: Drag) -> bool:
        times = [picture.at for picture in drag.shown]
        return any(last - first < 1e3 * FAR for first, last in zip(times, times[LEAST + 1 :], strict=False))

    far = slow_link(view.port, bits_per_second=1e9, round_trip=FAR)
    with far as port, under_a_hand(view.url.replace(f":{view.port}/", f":{port}/")) as tab:
        drags = [dragged(tab, 60)]
        ends = time.monotonic() + PATIENCE
        while not followed_closely(drags[-1]) and time.monotonic() < ends:  # how many go is learnt on the way
            drags.append(dragged(tab, 60))
    assert followed_closely(drags[-1])
    assert not any(drag.stale() for drag in drags)
    assert all(drag.shown[-1].event >= drag.sent[-1][0] for drag in drags)


def test_a_lost_server_is_told_on_the_page_and_the_others_take_over(volume: Path, browser_page: Page) -> None:
    with viewed(volume.parent, volume, "--workers", "2") as view:
        page = opened(browser_page, view.url)
        box = page.locator(".vs-picture").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 200, box["y"] + 200)
        page.mouse.down()
        page.mouse.move(box["x"] + 220, box["y"] + 200, steps=4)
        view.mapshade_servers()[0].kill()
        page.get_by_text("others take over").first.wait_for()

        def go_on() -> None:
            page.mouse.move(box["x"] + 260, box["y"] + 210, steps=4)
            page.mouse.up()

        left = after(page, go_on)
        assert left[..., :3].any()
        page.goto("about:blank")


def splat_servers(view: Viewed) -> list[psutil.Process]:
    return [server for server in view.person.servers() if is_server(server, "splat_server")]


def text_with(page: Page, element: Locator, news: re.Pattern[str]) -> str:
    """What the element says once it has these news: the next ones may take their place at any moment."""
    seen: list[str] = []

    def has_news() -> bool:
        seen.append(element.inner_text())
        return news.search(seen[-1]) is not None

    until(page, has_news)
    return seen[-1]


def test_the_page_shows_how_a_lost_splat_server_is_replaced_and_starts_again_what_has_ended(
    volume: Path, browser_page: Page
) -> None:
    with viewed(volume.parent, volume, "--workers", "2") as view:
        page = opened(browser_page, view.url)
        before = canvas(page)
        told = page.locator(".vs-trouble")
        killed: set[int] = set()
        said = ""
        while "nothing can be drawn until" not in said:
            until(page, lambda: any(server.pid not in killed for server in splat_servers(view)))
            (server,) = [server for server in splat_servers(view) if server.pid not in killed]
            killed.add(server.pid)
            server.kill()
            # Nothing of those that were lost before, and replaced. Of the last one it is told that its connection is
            # lost or that its process has ended, whichever is seen first.
            replaced = "another one is started in its place .*whole again"
            either = f"({replaced}|nothing can be drawn until)"
            news = re.compile(f"splat server .*process {server.pid}.*{either}", re.DOTALL)
            said = text_with(page, told, news)
            if len(killed) < 4:  # as often another one is started within a minute
                until(page, lambda: torch.equal(canvas(page), before))
        assert len(killed) >= 4
        page.get_by_text("Servers", exact=True).click()
        states = page.locator(".vs-servers-table").first.locator("tbody tr td:last-child")
        until(page, lambda: "drawing" not in states.all_inner_texts())
        again = page.get_by_role("button", name="start it again")
        again.click()
        again.wait_for(state="hidden")
        until(page, lambda: states.all_inner_texts() == ["idle"] * 3)
        page.get_by_text("Servers", exact=True).click()  # the picture has its size again
        until(page, lambda: torch.equal(canvas(page), before))
        lost = view.mapshade_servers()[0]
        lost.kill()
        told_to_stay = re.compile(f"note: map/shade server .*process {lost.pid}")
        wait_until(lambda: any(map(told_to_stay.match, view.said)), "told on the terminal, as by the first session")
        page.goto("about:blank")
