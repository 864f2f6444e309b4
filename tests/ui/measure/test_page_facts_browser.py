"""What a page tells of a real volume: its values, lengths, sides and names, and what its reader had to assume."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from astropy.io import fits

from support.files.opened import read_whole
from support.pages.browser import browser
from support.pages.page_tab import after, kept_open
from support.pages.tables_tab import box
from support.pages.viewed import Viewed, viewed
from volsplat.client.phantoms import make_phantom

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

__all__ = ["browser"]

SIZE = (24, 32, 28)
SPECTRAL = {
    "CTYPE1": "RA---TAN",
    "CTYPE2": "DEC--TAN",
    "CTYPE3": "VELO-LSR",
    "CUNIT1": "deg",
    "CUNIT2": "deg",
    "CUNIT3": "m/s",
    "CDELT1": -0.01,
    "CDELT2": 0.01,
    "CDELT3": 1000.0,
    "CRPIX1": 12,
    "CRPIX2": 16,
    "CRPIX3": 1,
    "CRVAL1": 50.0,
    "CRVAL2": 30.0,
    "CRVAL3": 2000.0,
}


def head_of(folder: Path) -> Path:
    """Voxels that are twice as long along k, in no unit."""
    path = folder / "head.nrrd"
    values, _ = make_phantom("head", SIZE)
    sizes = " ".join(map(str, SIZE))
    head = f"NRRD0004\ntype: ushort\ndimension: 3\nsizes: {sizes}\nspacings: 1 1 2\nendian: little\nencoding: raw\n\n"
    path.write_bytes(head.encode() + values.numpy().astype("<u2").tobytes())
    return path


def cube_of(folder: Path) -> Path:
    """A spectral cube."""
    path = folder / "cube.fits"
    values, _ = make_phantom("head", SIZE)
    image = fits.PrimaryHDU(values.numpy().astype(np.float32))
    image.header.update(SPECTRAL)
    image.writeto(path)
    return path


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return head_of(tmp_path_factory.mktemp("head"))


@pytest.fixture(scope="module")
def head(volume: Path) -> Iterator[Viewed]:
    with viewed(volume.parent, volume, "--workers", "1") as running:
        yield running


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewed]:
    path = cube_of(tmp_path_factory.mktemp("cube"))
    with viewed(path.parent, path, "--workers", "1") as running:
        yield running


@pytest.fixture
def head_page(browser: Browser, head: Viewed, request: pytest.FixtureRequest) -> Iterator[Page]:
    with kept_open(browser, head, request) as page:
        yield page


@pytest.fixture
def cube_page(browser: Browser, cube: Viewed, request: pytest.FixtureRequest) -> Iterator[Page]:
    with kept_open(browser, cube, request) as page:
        yield page


def test_a_value_beyond_the_window_is_the_files_own(head_page: Page, volume: Path) -> None:
    from playwright.sync_api import expect

    page = head_page
    values = read_whole(volume)
    narrow = float(np.percentile(values[values > values.min()], 5))

    def cut_the_window() -> None:
        page.get_by_label("highest value").fill(f"{narrow:.5g}")
        page.keyboard.press("Enter")

    after(page, cut_the_window)
    box = page.locator(".vs-picture").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    value = page.locator(".vs-value")
    expect(value).to_have_text(re.compile(r"^value -?[0-9.e]+ ·"))  # and neither ≈ nor ≥
    told = re.search(r"^value (\S+) .* at \((\d+), (\d+), (\d+)\)$", value.text_content() or "")
    assert told is not None
    i, j, k = map(int, told.groups()[1:])
    own = values[k, j, i]
    assert own > narrow and own.dtype.type(told[1]) == own
    after(page, lambda: page.get_by_label("undo", exact=True).click())


def test_voxels_of_unequal_sides_and_no_unit_have_a_bar_for_each_length(head_page: Page) -> None:
    page = head_page
    bars = [re.fullmatch(r"(.*) ([0-9.]+) voxels?", words) for words in page.locator(".vs-scale").all_inner_texts()]
    assert [bar and bar[1] for bar in bars] == ["i, j", "k"]
    counts = [float(bar[2]) for bar in bars if bar]
    widths = page.locator(".vs-scale-bar").evaluate_all("bars => bars.map(b => b.getBoundingClientRect().width)")
    a_voxel = [width / count for width, count in zip(widths, counts, strict=True)]
    assert a_voxel[1] / a_voxel[0] == pytest.approx(2.0, rel=0.03)


def test_what_matters_most_stands_first_and_scales_are_named(head_page: Page) -> None:
    page = head_page
    panels = page.locator(".vs-left .vs-title").all_inner_texts()
    assert panels[0] == "Window", panels
    window = page.get_by_label("highest value").bounding_box()
    assert window is not None and window["y"] + window["height"] < 200
    assert not re.search(r"[0-9] m?s\b", page.locator(".vs-head").inner_text()), "no stop-watch in the header"
    row = page.locator(".vs-row", has=page.get_by_text("All opacities", exact=True))
    assert "log" in row.inner_text().split()


def test_the_terminal_tells_the_address_and_warns_of_nothing(head: Viewed, head_page: Page) -> None:
    assert head_page.title().startswith("head.nrrd")
    assert "Warning" not in "".join(head.said)
    assert [line.split()[0] for line in head.said if line.strip()] == ["head.nrrd", head.url]


def test_axes_of_different_kinds_have_bars_sides_and_a_note_of_their_own(cube: Viewed, cube_page: Page) -> None:
    from playwright.sync_api import expect

    page = cube_page
    bars = [re.sub(r" [0-9.]+ ", " ", words) for words in page.locator(".vs-scale:visible").all_inner_texts()]
    assert bars == ["RA, Dec arcmin"], "one looks along velocity"
    room = box(page.locator(".vs-cube"))
    page.mouse.move(room["x"] + room["width"] / 2, room["y"] + room["height"] / 2)
    for key, view, axis in (("5", "top", "Dec"), ("3", "left", "RA"), ("1", "front", "vel")):
        page.keyboard.press(key)
        told = re.compile(rf"look from the {view} \([+−]?{axis}[+−]?\)")
        expect(page.locator(".vs-cube")).to_have_attribute("title", told)
    page.get_by_role("button", name="about this volume: 1 note of its reader").click()
    noted = page.locator(".vs-noted")
    noted.wait_for()
    assert "velocity has no length on the sky" in noted.inner_text()
    assert any("velocity has no length" in line for line in cube.said), "the terminal tells it as well"
    page.keyboard.press("Escape")
    noted.wait_for(state="hidden")


# What is heard, or seen by whoever points at it.
NAMES = """() => [...document.querySelectorAll("[aria-label], [title]")].flatMap(
    (one) => ["aria-label", "title", "aria-valuetext"].map((name) => one.getAttribute(name)).filter(Boolean))"""
SHORT_FOR_TABLES = re.compile(r"\b(emit|refl|opac|modu)\b")


def test_each_thing_has_one_name_on_the_whole_page(cube_page: Page) -> None:
    page = cube_page
    words = [page.locator("body").inner_text(), *page.evaluate(NAMES)]
    assert len(words) > 200
    assert [words for words in words if SHORT_FOR_TABLES.search(words)] == []
    # What the file holds is an intensity, and nowhere a density.
    assert [words for words in words if "density" in words.replace("intensity", "")] == []
    assert page.locator(".vs-wire-heads").inner_text().split()[:2] == ["int", "str"]
    for name in ("lowest intensity", "highest intensity", "shift of all tables by intensity"):
        assert page.get_by_label(name, exact=True).count() == 1
    assert page.get_by_role("group", name="patches over intensity and gradient strength", exact=True).count() == 1
