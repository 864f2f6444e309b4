"""The docs' tables of scene keys and of the page's messages are those of the code."""

from pathlib import Path

import pytest

from support.generated_docs import remade
from support.pages.declared_tables import PAGES, TABLES


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_the_page_shows_what_is_declared(path: Path) -> None:
    page = path.read_text(encoding="utf-8")
    assert remade(page, TABLES) == page, "run, in tests/: python -m support.pages.declared_tables"


def test_every_table_is_shown() -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in PAGES)
    assert all(table() in pages for table in TABLES.values())
