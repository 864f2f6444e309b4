"""Libraries that not every machine has: an extra of the package brings each (pyproject.toml)."""

from importlib.util import find_spec

from volsplat.protocol.text.errors import BadInput


def lacking(library: str, purpose: str, extra: str) -> BadInput:
    """What to raise if `library`, which `purpose` needs, is not installed; it names the cure."""
    return BadInput(f"{purpose} needs {library}, which is not installed: pip install 'volsplat[{extra}]'")


def need(library: str, purpose: str, extra: str) -> None:
    """Raise BadInput, with the cure, if `library`, which `purpose` needs, is not installed."""
    if find_spec(library) is None:
        raise lacking(library, purpose, extra)
