"""Colour maps by name on the page: a list with each one's colours, which either or both tables of colours take."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import cache
from typing import TypedDict

import msgspec
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from volsplat.client.scene.colour_maps import colormap, colormap_names, colours_along, lit_and_glowing
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.client.ui.tables.table_edits import simplified
from volsplat.protocol.description.colours import nearest_hex
from volsplat.protocol.description.scene_keys import TABLE_WORDS
from volsplat.protocol.description.shading_tables import Tables
from volsplat.protocol.text.errors import BadInput

BOTH = "both"
COLOURED = ("emit", "refl")
SAMPLES = 24  # of a stripe
OTHERWISE = "The menu of a table loads its colours from a file."


class _Striped(TypedDict):
    name: str
    colours: list[str]


class _Listed(TypedDict):
    maps: list[_Striped]
    notes: list[str]


class ColourMapList(Element, component="colour_map_list_component.js", esm=MODULES):
    """`take(change)` is called with what changes the tables by the map that a person chose."""

    def __init__(self, take: Callable[[Callable[[Tables], Tables]], None]) -> None:
        super().__init__()
        self._take = take
        self._props.update(maps=[], notes=[], first=BOTH)
        self._props["tables"] = {BOTH: "both", **{which: TABLE_WORDS[which].lower() for which in COLOURED}}
        self.on("taken", self._taken)

    async def fill(self) -> None:
        """Once it is opened: matplotlib takes a second or two to load, and most pages never ask."""
        if self._props["maps"] or self._props["notes"]:
            return
        found = await asyncio.to_thread(listed)
        if not self.is_deleted:
            self._props.update(found)
            self.update()

    def _taken(self, event: GenericEventArguments) -> None:
        """Of what a browser says only what was offered is taken."""
        name, which = str(event.args["name"]), str(event.args["which"])
        if which in self._props["tables"] and any(name == one["name"] for one in self._props["maps"]):
            self._take(lambda tables: with_colours(tables, name, which))


def with_colours(tables: Tables, name: str, which: str) -> Tables:
    """The tables with a colour map in one of them, as it is, or in both as the light of a surface, in few points."""
    table = colormap(name)
    given = lit_and_glowing(table)._asdict() if which == BOTH else {which: table}
    return msgspec.structs.replace(tables, **{key: simplified(colours) for key, colours in given.items()})


@cache
def listed() -> _Listed:
    """What is to be had here, or why nothing is."""
    try:
        names, troubles = colormap_names()
    except BadInput as error:
        return {"maps": [], "notes": [str(error), OTHERWISE]}
    maps: list[_Striped] = [{"name": name, "colours": _stripe(name)} for name in names]
    return {"maps": maps, "notes": list(troubles)}


def _stripe(name: str) -> list[str]:
    return [nearest_hex(colour) for _, colour in colours_along(name, SAMPLES)]
