"""The libraries of the extra [formats]: imported on first use, and asked for by name if they are missing."""

import importlib
from types import ModuleType

from volsplat.program.extras import lacking


def library(name: str, what: str) -> ModuleType:
    """The module `name`. Raises BadInput, with the cure, if it is not installed; `what` cannot be read then."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != name.partition(".")[0]:
            raise
        raise lacking(name, what, "formats") from None
