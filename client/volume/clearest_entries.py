"""A 2-D table by density alone: of each density what is shown at the strength at which it is most opaque."""

from functools import lru_cache
from typing import NamedTuple

from volsplat.client._kernels import PatchTable
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.patches import Patches
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES

REMEMBERED = 4  # tables


class Entry(NamedTuple):
    opacity: float
    emit: Colour
    refl: Colour


@lru_cache(REMEMBERED)
def clearest_entries(patches: Patches) -> tuple[Entry, ...]:
    """One for each density byte."""
    table = PatchTable([patch.numbers for patch in patches])
    opacity, emit, refl = (memoryview(of) for of in (table.opacity, table.emit, table.refl))

    def colour(of: memoryview, at: int) -> Colour:
        return (of[at, 0], of[at, 1], of[at, 2])

    places = [density + TABLE_ENTRIES * strength for density, strength in enumerate(table.clearest())]
    return tuple(Entry(opacity[at], colour(emit, at), colour(refl, at)) for at in places)
