"""A picture that a tool draws in a notebook alone: the notebook's server, a browser on it, and its cell run there.

    python -m first_pictures.notebook_peer PYTHON SCRIPT PICTURE

PYTHON is of the environment that has the notebook (the classic one) and the tool; the script becomes a cell. The
picture is what the cell shows, as soon as two looks at it, a second apart, find the same, and something in it.
"""

from __future__ import annotations

import io
import json
import re
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image, ImageStat

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

LIMIT = 240.0  # seconds, until the cell shows something
SHOWN = ".output_area canvas"
LEAST_SPREAD = 2.0  # of grey levels: below it nothing is drawn yet
LEVELS = 1.0  # mean difference of two looks that are the same


def notebook(script: str) -> str:
    cell: dict[str, object] = {"cell_type": "code", "source": script, "outputs": [], "execution_count": None}
    cell["metadata"] = {}
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return json.dumps({"cells": [cell], "metadata": kernel, "nbformat": 4, "nbformat_minor": 5})


def served(python: Path, folder: Path) -> tuple[subprocess.Popen[str], str]:
    """The notebook's server, and its address."""
    with socket.create_server(("127.0.0.1", 0)) as found_free:
        port = found_free.getsockname()[1]
    said = ["--no-browser", "--allow-root", f"--port={port}", f"--notebook-dir={folder}"]
    command = [str(python), "-m", "notebook", *said]
    program = subprocess.Popen(command, stderr=subprocess.PIPE, encoding="utf-8", errors="replace")
    assert program.stderr is not None
    for line in program.stderr:
        if found := re.search(r"http://(?:localhost|127\.0\.0\.1):\d+/\S*token=\w+", line):
            return program, found[0]
    raise SystemExit(f"the notebook's server of {python} ended before it served")


def picture_of(page: Page, address: str, name: str) -> Image.Image:
    place, _, token = address.partition("?")
    page.goto(f"{place.rstrip('/')}/notebooks/{name}?{token}")
    page.wait_for_selector(".kernel_idle_icon", state="attached")
    page.get_by_role("menuitem", name="Cell").or_(page.locator("#menus").get_by_text("Cell", exact=True)).first.click()
    page.locator("#run_all_cells a").click()
    return settled(page, page.locator(SHOWN).first)


def settled(page: Page, shown: Locator) -> Image.Image:
    until, before = time.monotonic() + LIMIT, None
    while time.monotonic() < until:
        if trouble := page.locator(".output_error").all_inner_texts():
            raise SystemExit(trouble[0].strip().splitlines()[-1])
        if shown.is_visible():
            now = Image.open(io.BytesIO(shown.screenshot())).convert("RGB")
            if before is not None and before.size == now.size and is_drawn(before, now):
                return now
            before = now
        page.wait_for_timeout(1000)
    raise SystemExit(f"nothing was shown in {LIMIT:.0f} s")


def is_drawn(before: Image.Image, now: Image.Image) -> bool:
    from PIL import ImageChops

    moved = max(ImageStat.Stat(ImageChops.difference(before, now)).mean)
    return moved < LEVELS and max(ImageStat.Stat(now).stddev) > LEAST_SPREAD


def main(python: Path, script: Path, picture: Path) -> None:
    from playwright.sync_api import sync_playwright

    folder = picture.parent
    name = f"{picture.stem}.ipynb"
    (folder / name).write_text(notebook(script.read_text(encoding="utf-8")), encoding="utf-8")
    program, address = served(python, folder)
    try:
        with sync_playwright() as playwright:
            chromium = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
            page = chromium.new_page(viewport={"width": 1100, "height": 900})
            page.set_default_timeout(1000 * LIMIT)
            picture_of(page, address, name).save(picture)
            chromium.close()
    finally:
        program.terminate()
        program.wait()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
