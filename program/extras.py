"""Libraries that not every machine has: an extra of the package brings each (pyproject.toml)."""

from importlib.util import find_spec

from volsplat.protocol.text.errors import BadInput

WITH_TORCH = {"torch", "bench"}  # extras
# Elsewhere torch comes with gigabytes for graphics cards, which are never used.
CPU_BUILD = "--extra-index-url https://download.pytorch.org/whl/cpu"


def lacking(library: str, purpose: str, extra: str) -> BadInput:
    """What to raise if `library`, which `purpose` needs, is not installed; it names the cure."""
    options = f"{CPU_BUILD} " if extra in WITH_TORCH else ""
    return BadInput(f"{purpose} needs {library}, which is not installed: pip install {options}'volsplat[{extra}]'")


def need(library: str, purpose: str, extra: str) -> None:
    """Raise BadInput, with the cure, if `library`, which `purpose` needs, is not installed."""
    if find_spec(library) is None:
        raise lacking(library, purpose, extra)
