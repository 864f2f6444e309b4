"""The scripts of the page's components as one: it does what they do, and a browser asks for it once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page

from support.pages.browser import browser, browser_page
from support.pages.page_tab import opened
from support.pages.viewed import Viewed
from volsplat.client.ui.doors.script_bundle import bundled

__all__ = ["browser", "browser_page"]

MODULES = {
    "one.js": 'import { half as part } from "./shared.js";\nexport default { of: (x) => part(x) };\n',
    "other.js": 'import * as all from "./shared.js";\nexport default { of: (x) => all.half(x), runs: all.runs };\n',
    "shared.js": "export const runs = [1];\nruns.push(2);\nexport function half(x) {\n  return x / 2;\n}\n",
}


def written(folder: Path, modules: dict[str, str]) -> dict[str, Path]:
    for name, text in modules.items():
        (folder / name).write_text(text, encoding="utf-8")
    return {"first": folder / "one.js", "second": folder / "other.js"}


def test_a_bundle_exports_what_its_modules_do_and_runs_each_once(tmp_path: Path, browser_page: Page) -> None:
    script = bundled(written(tmp_path, MODULES))
    found = browser_page.evaluate(
        """async (script) => {
            const url = URL.createObjectURL(new Blob([script], { type: "text/javascript" }));
            const { first, second } = await import(url);
            return [first.of(3), second.of(5), second.runs];
        }""",
        script,
    )
    assert found == [1.5, 2.5, [1, 2]]


def test_a_module_of_others_is_not_bundled(tmp_path: Path) -> None:
    paths = written(tmp_path, MODULES | {"shared.js": 'import { ref } from "vue";\nexport const half = ref;\n'})
    with pytest.raises(ValueError, match="imports vue, which is no file of the page's"):
        bundled(paths)


def test_the_page_asks_for_one_script_of_ours_and_keeps_it(view: Viewed, browser_page: Page) -> None:
    asked: list[str] = []
    browser_page.on("request", lambda request: asked.append(request.url))
    opened(browser_page, view.url)
    (ours,) = [url for url in asked if "/volsplat/" in url]
    assert not any(re.search("/components/|viewport", url) for url in asked if url.startswith("http"))
    answer = browser_page.request.get(ours)
    assert answer.headers["cache-control"] == "private, max-age=31536000, immutable"
    assert browser_page.request.get(ours.replace(".js", "0.js")).status == 404


def test_no_element_is_built_anew_when_its_kind_first_changes(view: Viewed, browser_page: Page) -> None:
    asked: list[str] = []
    opened(browser_page, view.url)  # fields change when the scene takes this window's size; loaded anew, none do
    page = opened(browser_page, view.url)
    page.on("request", lambda request: asked.append(request.url))
    field, other = page.get_by_label("centre i"), page.get_by_label("centre j")
    fields = [field.element_handle(), other.element_handle()]
    field.select_text()
    page.keyboard.type("north")
    page.get_by_text("“north” is not a number").wait_for()
    assert all(page.evaluate("(field) => field.isConnected", held) for held in fields)
    assert field.input_value() == "north"
    assert not any("/components/" in url for url in asked)
