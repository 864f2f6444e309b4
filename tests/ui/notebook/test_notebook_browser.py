"""The widget in a notebook's cell, in a real browser: its viewport, and its steps and tables if these are asked for."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
import torch

from support.pages.browser import browser, browser_page
from support.pages.notebook_cell import NotebookCell, notebook_cell
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.tables.scene_tables import with_table
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Geometry

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page"]

replace = msgspec.structs.replace

FINISHED = ".vs-step.vs-done"
OPACITY = 'section[aria-label="Opacity"]'


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    path = tmp_path_factory.mktemp("notebook") / "shells.nrrd"
    write_volume(path, *make_phantom("shells", (16, 16, 16)))
    with Session(path, workers=1) as opened:
        yield opened


def drawn(cell: NotebookCell) -> bool:
    """Whether there is a picture in the viewport."""
    script = """() => {
      const canvas = document.querySelector(".vs-picture");
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return new Set(data).size > 10;
    }"""
    return bool(cell.page.evaluate(script))


def test_the_viewport_is_alone_where_nothing_else_is_asked_for(browser_page: Page, session: Session) -> None:
    with notebook_cell(browser_page, session, height=300) as cell:
        cell.until(lambda: drawn(cell))
        assert cell.page.locator(".vs-table, .vs-step, .vs-notebook-still").count() == 0
        assert cell.page.locator(".vs-viewport").bounding_box() == {"x": 8, "y": 8, "width": 1200, "height": 300}


@pytest.mark.parametrize("in_shadow", [False, True])
def test_words_over_the_picture_stand_on_a_panel(in_shadow: bool, browser_page: Page, session: Session) -> None:
    with notebook_cell(browser_page, session, in_shadow) as cell:
        scale = cell.page.locator(".vs-scale")
        cell.until(scale.is_visible)
        assert scale.evaluate("(element) => getComputedStyle(element).backgroundColor") != "rgba(0, 0, 0, 0)"


def test_a_key_over_the_picture_is_no_command_of_the_notebook(browser_page: Page, session: Session) -> None:
    """JupyterLab hears keys before any element does, and leaves out those whose own element says so."""
    with notebook_cell(browser_page, session, controls=True, height=600) as cell:
        cell.until(lambda: drawn(cell) and cell.page.locator(".vs-table").count() == 4)
        cell.page.evaluate("""() => {
          window.commands = [];
          const hear = ({ key, target }) => { if (!("lmSuppressShortcuts" in target.dataset)) commands.push(key); };
          document.addEventListener("keydown", hear, true);
        }""")
        cell.page.keyboard.press("d")
        cell.page.locator(".vs-picture").press("m")
        cell.page.locator(OPACITY).get_by_role("slider").last.press("x")
        assert cell.page.evaluate("commands") == ["d"]


def test_steps_and_tables_lie_beside_the_viewport(browser_page: Page, session: Session) -> None:
    with notebook_cell(browser_page, session, controls=True, height=600) as cell:
        page, finished = cell.page, cell.page.locator(FINISHED)
        cell.until(lambda: drawn(cell) and finished.count() == 6)
        assert page.locator(".vs-table").count() == 4
        page.get_by_role("button", name="refine to G").click()
        cell.until(lambda: finished.count() == 7)
        assert cell.widget.scene.refine.finest is Step.G

        point, before = page.locator(OPACITY).get_by_role("slider").last, cell.widget.scene.tables.opac
        value = float(point.get_attribute("aria-valuenow") or "nan")
        point.press("ArrowDown" if value > 0.5 else "ArrowUp")
        cell.until(lambda: cell.widget.scene.tables.opac != before)
        flat = ScalarTable(points=((0.0, 0.25), (0.5, 0.25), (1.0, 0.25)))
        cell.kernel(lambda: setattr(cell.widget, "scene", with_table(cell.widget.scene, "opac", flat)))
        cell.until(lambda: page.locator(OPACITY).get_by_role("slider").count() == 3)
        assert page.locator(OPACITY).get_by_role("slider").nth(1).get_attribute("aria-valuenow") == "0.25"


@pytest.mark.parametrize(("asked", "then"), [(Step.B, [Step.G, Step.B]), (Step.G, [Step.F, Step.G])])
def test_without_g_the_scene_asks_for_what_it_did_before(
    asked: Step, then: list[Step], browser_page: Page, session: Session
) -> None:
    scene = session.default_scene()
    asking = replace(scene, refine=replace(scene.refine, finest=asked))
    with notebook_cell(browser_page, session, controls=True, height=300, scene=asking) as cell:
        to_g = cell.page.get_by_role("button", name="refine to G")

        def shows(finest: Step) -> bool:
            is_g = cell.widget.scene.refine.finest is Step.G
            told = to_g.count() == 1 and to_g.get_attribute("aria-pressed") == str(is_g).lower()
            return told and cell.widget.scene.refine.finest is finest

        cell.until(lambda: shows(asked))
        for finest in then:
            to_g.click()
            cell.until(partial(shows, finest))


def test_labels_cannot_be_refined_to_g_and_say_why(browser_page: Page, tmp_path: Path) -> None:
    numbers = torch.arange(8**3)
    labels = torch.where(numbers < 300, 0, numbers % 5).reshape(8, 8, 8).to(torch.uint8)
    write_volume(tmp_path / "labels.nrrd", labels, Geometry((8, 8, 8)))
    with Session(tmp_path / "labels.nrrd", workers=1) as session:
        with notebook_cell(browser_page, session, controls=True, height=600) as cell:
            to_g = cell.page.get_by_role("button", name="refine to G")
            cell.until(lambda: drawn(cell) and to_g.is_disabled())
            assert "labels.nrrd holds the whole numbers 0 to 4" in (to_g.get_attribute("title") or "")


@pytest.mark.parametrize("controls", [False, True])
def test_a_page_without_a_kernel_has_the_picture_of_the_saved_notebook(
    controls: bool, browser_page: Page, session: Session
) -> None:
    with notebook_cell(browser_page, session, has_kernel=False, controls=controls, height=300) as cell:
        still = cell.page.locator(".vs-notebook-still")
        assert still.get_attribute("src") == f"data:image/png;base64,{cell.bundle['image/png']}"
        size = still.evaluate(
            "async (image) => { await image.decode(); return [image.naturalWidth, image.clientHeight]; }"
        )
        assert size == [cell.widget.scene.image.width, 300]
        assert still.is_visible() and not cell.page.locator(".vs-viewport").is_visible()


@pytest.mark.parametrize("told", [False, True])
def test_a_viewport_whose_kernel_was_restarted_says_so(told: bool, browser_page: Page, session: Session) -> None:
    with notebook_cell(browser_page, session, controls=True, height=600) as cell:
        cell.until(lambda: drawn(cell) and cell.page.locator(".vs-table").count() == 4)
        trouble = cell.page.locator(".vs-trouble")
        assert not trouble.is_visible()
        cell.restart_kernel(is_told=told)
        if not told:
            cell.page.locator(OPACITY).get_by_role("slider").last.press("ArrowUp")
        cell.until(trouble.is_visible)
        assert "the kernel was restarted, or has ended; run this cell again" in trouble.inner_text()
        cell.page.locator(".vs-picture").press("ArrowLeft")  # and the page raises nothing
