"""Colour maps by name, as tables: matplotlib's, and those that cmasher (cmr.NAME) and colorcet (cet_NAME) add to it."""

from __future__ import annotations

import difflib
from importlib import import_module
from importlib.util import find_spec

from volsplat.program.extras import lacking
from volsplat.protocol.description.scene import TABLE_ENTRIES, ColourTable
from volsplat.protocol.text.errors import BadInput

COLLECTIONS = {"cmr.": "cmasher", "cet_": "colorcet"}  # by the beginnings of their maps' names


def colormap(name: str, low: float = 0.0, high: float = 1.0) -> ColourTable:
    """The colour map as a table, from its start at `low` to its end at `high` of the table. Raises BadInput."""
    if find_spec("matplotlib") is None:
        raise lacking("matplotlib", f"the colour map {name}", "bench")
    import matplotlib

    for start, library in COLLECTIONS.items():
        if name.startswith(start):
            _add_maps_of(library, name)
    if name not in matplotlib.colormaps:
        near = difflib.get_close_matches(name, list(matplotlib.colormaps), 1)
        hint = f"; did you mean {near[0]}?" if near else "; matplotlib.colormaps lists them"
        raise BadInput(f"there is no colour map {name}{hint}")
    if not 0.0 <= low < high <= 1.0:
        raise BadInput(f"a colour map lies between low and high, within 0 and 1, not {low} and {high}")
    of = matplotlib.colormaps[name]
    places = [n / (TABLE_ENTRIES - 1) for n in range(TABLE_ENTRIES)]
    colours = [tuple(float(channel) for channel in of(place)[:3]) for place in places]
    points = [(low + (high - low) * place, colour) for place, colour in zip(places, colours, strict=True)]
    return ColourTable(points=tuple(points))  # type: ignore[arg-type]


def _add_maps_of(library: str, name: str) -> None:
    """Have matplotlib know them. Raises BadInput where they are not to be had."""
    if find_spec(library) is None:
        raise BadInput(f"the colour map {name} is one of {library}, which is not installed; run pip install {library}")
    try:
        import_module(library)
    except ImportError as error:
        raise BadInput(
            f"the colour map {name} needs {library}, which does not load ({error}); install it anew"
        ) from None
