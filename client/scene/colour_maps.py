"""Colour maps by name, as tables: matplotlib's, and those that cmasher (cmr.NAME) and colorcet (cet_NAME) add to it."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

from volsplat.client.caller.arguments import checked_number
from volsplat.client.scene.table_makers import GLOW, dimmed
from volsplat.program.extras import need
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.meant import meant

COLLECTIONS = {"cmr.": "cmasher", "cet_": "colorcet"}  # by the beginnings of their maps' names


class ColourMapNames(NamedTuple):
    """What is to be had here, and a line for each library that does not load."""

    names: tuple[str, ...]
    troubles: tuple[str, ...]


class LitAndGlowing(NamedTuple):
    """A colour map for what a surface emits and for what it reflects, which add up."""

    emit: ColourTable
    refl: ColourTable


def colormap(name: str | Any, low: float = 0.0, high: float = 1.0) -> ColourTable:
    """The colour map as a table, from its start at `low` to its end at `high` of the table. Raises BadInput.

    `name` may be a colour map of matplotlib's itself.
    """
    of = _named(name) if isinstance(name, str) else name
    if not callable(of) or not hasattr(of, "N"):
        raise BadInput(f"a colour map is named by a text, as 'magma', or is matplotlib's own, not {name!r:.60}")
    low, high = checked_number(low, "low"), checked_number(high, "high")
    if not 0.0 <= low < high <= 1.0:
        raise BadInput(f"a colour map lies between low and high, within 0 and 1, not {low} and {high}")
    points = [(low + (high - low) * place, colour) for place, colour in _along(of, TABLE_ENTRIES)]
    return ColourTable(points=tuple(points))


def _named(name: str) -> Any:
    """Matplotlib's colour map. Raises BadInput."""
    need("matplotlib", f"the colour map {name}", "bench")
    import matplotlib

    for start, library in COLLECTIONS.items():
        if name.startswith(start):
            _add_maps_of(library, f"the colour map {name}")
    if name not in matplotlib.colormaps:
        cure = meant(name, list(matplotlib.colormaps), "matplotlib.colormaps lists them")
        raise BadInput(f"there is no colour map {name}; {cure}")
    return matplotlib.colormaps[name]


def colours_along(name: str, count: int) -> list[tuple[float, Colour]]:
    """So many places of a colour map that is known, from 0 to 1, and its colours there."""
    import matplotlib

    return _along(matplotlib.colormaps[name], count)


def _along(of: Any, count: int) -> list[tuple[float, Colour]]:
    places = [n / (count - 1) for n in range(count)]
    return [(place, (float(r), float(g), float(b))) for place, (r, g, b, *_) in zip(places, of(places), strict=True)]


def lit_and_glowing(table: ColourTable) -> LitAndGlowing:
    """A map's colours for both tables of colours, which make the map itself where a surface faces the light.

    Elsewhere they are darker, and lighter only by highlights.
    """
    return LitAndGlowing(dimmed(table, GLOW), dimmed(table, 1.0 - GLOW))


def colormap_names() -> ColourMapNames:
    """All that `colormap` knows here. Raises BadInput without matplotlib."""
    need("matplotlib", "a list of colour maps", "bench")
    import matplotlib

    troubles = []
    for library in COLLECTIONS.values():
        try:
            if find_spec(library) is not None:
                _add_maps_of(library, "a list of colour maps")
        except BadInput as error:
            troubles.append(str(error))
    return ColourMapNames(tuple(sorted(matplotlib.colormaps, key=str.casefold)), tuple(troubles))


def _add_maps_of(library: str, what: str) -> None:
    """Have matplotlib know them. Raises BadInput where they are not to be had."""
    if find_spec(library) is None:
        raise BadInput(f"{what} is one of {library}, which is not installed; run pip install {library}")
    try:
        import_module(library)
    except Exception as error:  # one that is made for another matplotlib ends in anything
        raise BadInput(f"{what}: {library} does not load ({error}); install it anew") from error
