"""Libraries that not every machine has: an extra of the package brings each (pyproject.toml)."""

from importlib.util import find_spec

from volsplat.protocol.text.errors import BadInput


def need(library: str, purpose: str, extra: str) -> None:
    """Raise BadInput, with the cure, if `library`, which `purpose` needs, is not installed."""
    if find_spec(library) is None:
        raise BadInput(f"{purpose} needs {library}, which is not installed: pip install 'volsplat[{extra}]'")
