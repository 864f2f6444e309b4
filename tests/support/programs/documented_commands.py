"""Finds the commands and the Python that README and docs print for a reader to type."""

import re
from dataclasses import dataclass
from textwrap import dedent

from support.checkout import ROOT

PAGES = ("README.md", "CONTRIBUTING.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md")))

_COMMAND = re.compile(r"^ {4}(volsplat .*?)(?:\s+# .*)?$", re.MULTILINE)
_BLOCK = re.compile(r"(?<=^\n)(?:^ {4}.*\n)+", re.MULTILINE)
_PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Documented:
    """A command line or a piece of Python, and the page that it stands on."""

    page: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}: {self.text.splitlines()[0]}"


def commands() -> list[Documented]:
    """The lines that begin with `volsplat`, in the order of the pages, without the words behind them."""
    return [Documented(page, text) for page in PAGES for text in _COMMAND.findall(_read(page))]


def blocks(page: str) -> list[Documented]:
    """The indented blocks of a page, which a reader pastes into a shell."""
    return [Documented(page, dedent(text)) for text in _BLOCK.findall(_read(page))]


def snippets() -> list[Documented]:
    """The blocks of Python."""
    return [Documented(page, text) for page in PAGES for text in _PYTHON.findall(_read(page))]


def _read(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")
