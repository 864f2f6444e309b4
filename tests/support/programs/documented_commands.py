"""Finds the commands and the Python that README and docs print for a reader to type, and says who runs them."""

import re
from dataclasses import dataclass
from textwrap import dedent

from support.checkout import ROOT

PAGES = ("README.md", "CONTRIBUTING.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md")))

# Typed whole, from top to bottom: by the build of the site one page after the other in one folder, so that a reader who
# follows them has the same files, …
TYPED_BY_SITE = tuple(
    f"docs/{page}.md"
    for page in ("start/tour", "start/glossary", "howto/fog", "howto/movie", "howto/batch", "howto/large")
)
# … by a test in a lab, …
TYPED_IN_LAB = ("docs/howto/lab.md",)
# … and by test_documented_commands.py each in a folder of its own, but for the lines below.
TYPED_ALONE = (
    "README.md",
    *(f"docs/howto/{page}.md" for page in ("export", "figures", "presets", "step_g", "watching")),
    "docs/reference/gallery.md",
)

# What no test types as it stands there, and why. That the options of all of them exist is tested all the same.
NOT_RUN = {
    r"192\.168\.|node1:7000|9100": "needs other machines: test_command_line.py and test_metrics.py start servers",
    r"lab\.toml": "needs machines: test_lab_page.py has some, test_deploy.py and test_dask.py clusters",
    r"^ssh ": "needs another machine: test_gate.py asks at a port that is forwarded",
    r"https://|4HHB|scans/#|ome\.tif|wind\.vti|run\.h5|head\.raw": "needs other files: the readers' tests have such",
    r"--behind": "needs a hub's proxy: test_behind_proxy_browser.py has one that does the same",
    r" bench ": "takes minutes: test_bench_commands.py runs each on small volumes",
    r" gallery ": "takes a minute: test_gallery.py draws the plates small",
    r"brain": "needs a volume larger than memory: test_prepare.py prepares and draws small ones",
    r"^make test": "runs this test",
    r"^make install|^pip |^uv |/pip install|activate$": "loads gigabytes: test_installation.py",
    r"_VOLSPLAT_COMPLETE": "is for a shell's start file: test_help.py asks for completions",
    r"^openssl |^head -c |^ps ": "needs a session at a port of its own: test_attackers_tour.py does the same",
    r"first_pictures|^cd tests": "installs other tools: test_first_pictures.py scores what ours draws",
}

_COMMAND = re.compile(r"^ {4}(volsplat .*?)(?:\s+# .*)?$", re.MULTILINE)
_FENCE = re.compile(r"^```(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TEST = re.compile(r"(…|\btest_\w+\.py)::(test_\w+)")
_BLOCK = re.compile(r"(?<=^\n)(?:^ {4}.*\n)+", re.MULTILINE)


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
    return [Documented(page, dedent(text)) for text in _BLOCK.findall(_FENCE.sub("", _read(page)))]


def lines(page: str) -> list[Documented]:
    """The lines of these blocks, without comments."""
    typed = (re.sub(r"(^|\s+)# .*$", "", line) for block in blocks(page) for line in block.text.splitlines())
    return [Documented(page, line) for line in typed if line]


def reason_not_to_run(line: Documented) -> str | None:
    return next((reason for pattern, reason in NOT_RUN.items() if re.search(pattern, line.text)), None)


def fences(language: str) -> list[Documented]:
    """The fenced blocks of a language, as ```python."""
    found = ((page, fence) for page in PAGES for fence in _FENCE.findall(_read(page)))
    return [Documented(page, text) for page, (said, text) in found if said == language]


def snippets() -> list[Documented]:
    """The blocks of Python."""
    return fences("python")


def links(page: str) -> list[str]:
    """What a page links to within the checkout, without the heading."""
    targets = re.findall(r"\]\(([^)#\s]+)(?:#[^)\s]*)?\)", _FENCE.sub("", _read(page)))
    return [target for target in targets if "://" not in target]


def named_tests() -> list[Documented]:
    """The tests that pages name as `file::test`, a file once for several: `…::test` is of the one before."""
    found = []
    for page in PAGES:
        file = ""
        for told, test in _TEST.findall(_read(page)):
            file = file if told == "…" else told
            found.append(Documented(page, f"{file}::{test}"))
    return found


def _read(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")
