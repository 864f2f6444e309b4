"""The site of the docs: built without a warning, by commands that work, and complete in itself."""

import re
import subprocess
import sys
from pathlib import Path

from support.checkout import ROOT
from support.patience import PATIENCE

LOADED = re.compile(r"<(?:script|link|img|iframe)\b[^>]*?\b(?:src|href)=\"((?:https?:)?//[^\"]+)\"")


def test_the_site_is_built_without_a_warning_and_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    arguments = ["--fail-on-warning", "--quiet", "--builder", "html", "--doctree-dir", str(tmp_path / "trees")]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *arguments, str(ROOT / "docs"), str(tmp_path / "site")],
        capture_output=True,
        encoding="utf-8",
        timeout=10 * PATIENCE,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pages = {page.relative_to(tmp_path / "site") for page in (tmp_path / "site").rglob("*.html")}
    written = {page.relative_to(ROOT / "docs").with_suffix(".html") for page in (ROOT / "docs").rglob("*.md")}
    assert written <= pages
    for page in pages:
        assert LOADED.findall((tmp_path / "site" / page).read_text(encoding="utf-8")) == [], page
