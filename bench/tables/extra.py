"""The libraries of the extra [bench], which only some benchmarks need."""

from importlib.util import find_spec

from volsplat.protocol.text.errors import BadInput


def need(library: str, purpose: str) -> None:
    """Raise BadInput, with the cure, where `library` is not installed."""
    if find_spec(library) is None:
        raise BadInput(f"{purpose} needs {library}, which is not installed: pip install 'volsplat[bench]'")
