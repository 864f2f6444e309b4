"""Which array of a VTK file is drawn: the one that the name's part names, else the active or only one of scalars.

If there are no scalars it is the only one of vectors, by their magnitude.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from volsplat.mapshade_server.readers.reading.components import (
    MOST_NUMBERED,
    Component,
    are_colours,
    chosen_component,
    has_magnitude,
    parts_of_components,
)
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.vtk_ghosts import GHOST_TYPE, GHOSTS, Ghosts, Reader
from volsplat.protocol.text.errors import BadInput

ASSOCIATIONS = ("PointData", "CellData")  # as VTK calls what arrays belong to


@dataclass
class NamedArray:
    """An array as it is announced; `components` is 0 if the file does not state it as a number."""

    name: str
    components: int
    of_cells: bool

    @property
    def association(self) -> str:
        return ASSOCIATIONS[self.of_cells]

    @property
    def scalar_type(self) -> str:
        """The type of its numbers, "" if it is not read."""
        raise NotImplementedError

    @property
    def has_components(self) -> bool:
        """Whether it has several numbers that can be drawn one by one."""
        several = 1 < self.components <= MOST_NUMBERED and self.scalar_type != ""
        return several and not are_colours(self.components, self.scalar_type)

    def parts(self, name: str) -> list[Part]:
        """What of it can be drawn; it goes by this name."""
        told = "of cells" if self.of_cells else "of points"
        if self.components == 1:
            return [Part(name, told)]
        return [Part(one.part, f"{one.told}, {told}") for one in parts_of_components(self.components, f"{name},")]


AnyArray = TypeVar("AnyArray", bound=NamedArray)


def chosen_array(
    path: Path, part: str, arrays: Sequence[AnyArray], active: Mapping[str, str]
) -> tuple[AnyArray, Component]:
    """The array that `part` names, as `density`, `CellData/density` or `velocity,x`, and what is drawn of it.

    Points go before cells if none is named, and scalars before vectors, and these before longer arrays.
    `active` has the names of the scalars that VTK would take, by association. Raises BadInput if one must be named.
    """
    arrays = _without_ghosts(arrays)
    if part:
        return _named(path, part, arrays)
    several = [one for one in arrays if one.has_components]
    candidates = [one for one in arrays if one.components == 1]
    candidates = candidates or [one for one in several if has_magnitude(one.components)] or several
    for association in ASSOCIATIONS:
        found = [one for one in candidates if one.association == association]
        taken = [one for one in found if one.name == active.get(association)]
        if taken or len(found) == 1:
            return _drawn(path, (taken or found)[0], (taken or found)[0].name, None)
        if found:
            line = f"{path}: holds {_listed(found)}; choose one, as in {path}#{found[0].name}"
            raise PartNeeded(line, [part for one in found for part in one.parts(one.name)])
    if arrays:
        raise BadInput(
            f"{path}: has only {_listed(arrays)}, volsplat needs one number a voxel; save a component or the magnitude"
        )
    raise BadInput(f"{path}: has no data of its points or cells; save the grid again")


def parts_of_arrays(part: str, arrays: Sequence[NamedArray]) -> list[Part]:
    """What could be named in place of what is taken if nobody names an array; none where one is named or alone."""
    drawable = [one for one in _without_ghosts(arrays) if one.components == 1 or one.has_components]
    parts = [told for one in drawable for told in one.parts(f"{one.association}/{one.name}")]
    return parts if not part and len(parts) > 1 else []


def ghosts_of(arrays: Sequence[AnyArray], read: Callable[[AnyArray], Reader], reads_whole: bool) -> Ghosts:
    """What tells which points and cells are hidden."""

    def reader(of_cells: bool) -> Reader | None:
        found = (one for one in arrays if one.name == GHOSTS and one.of_cells == of_cells)
        return next((read(one) for one in found if one.components == 1 and one.scalar_type == GHOST_TYPE), None)

    return Ghosts(reader(False), reader(True), reads_whole)


def _without_ghosts(arrays: Sequence[AnyArray]) -> list[AnyArray]:
    return [one for one in arrays if one.name != GHOSTS]


def _named(path: Path, part: str, arrays: Sequence[AnyArray]) -> tuple[AnyArray, Component]:
    for one in arrays:
        if part in (one.name, f"{one.association}/{one.name}"):
            return _drawn(path, one, part, None)
    name, _, said = part.rpartition(",")
    for one in arrays:
        if one.components != 1 and name in (one.name, f"{one.association}/{one.name}"):
            return _drawn(path, one, name, said)
    raise BadInput(f"{path}: has no array “{part}”; it has {_listed(arrays) or 'none'}")


def _drawn(path: Path, array: AnyArray, name: str, said: str | None) -> tuple[AnyArray, Component]:
    """The array, which goes by this name, and what is said to be drawn of it, None if nothing is. Raises BadInput."""
    if array.components == 1:
        return array, Component()
    if array.components < 1 or are_colours(array.components, array.scalar_type):
        raise BadInput(
            f"{path}: “{name}” has {array.components} components, volsplat needs one number a voxel; "
            "save one component or the magnitude"
        )
    return array, chosen_component(path, said, array.components, f"{name},")


def _listed(arrays: Sequence[NamedArray]) -> str:
    """The names, with what is unusual of each."""
    told = []
    for one in arrays:
        unusual = [f"{one.components} components"] if one.components != 1 else []
        unusual += ["of cells"] if one.of_cells else []
        told.append(f"{one.name} ({', '.join(unusual)})" if unusual else one.name)
    return ", ".join(told)
