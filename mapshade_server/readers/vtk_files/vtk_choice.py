"""Which array of a VTK file is drawn: the one that the name's part names, else the active or only one of scalars."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

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


AnyArray = TypeVar("AnyArray", bound=NamedArray)


def chosen_array(path: Path, part: str, arrays: Sequence[AnyArray], active: Mapping[str, str]) -> AnyArray:
    """The array that `part` names, as `density` or `CellData/density`; points go before cells if none is named.

    `active` has the names of the scalars that VTK would take, by association. Raises BadInput if one must be named.
    """
    arrays = _without_ghosts(arrays)
    if part:
        return _named(path, part, arrays)
    scalars = [one for one in arrays if one.components == 1]
    for association in ASSOCIATIONS:
        found = [one for one in scalars if one.association == association]
        taken = [one for one in found if one.name == active.get(association)]
        if taken or len(found) == 1:
            return (taken or found)[0]
        if found:
            line = f"{path}: holds {_listed(found)}; choose one, as in {path}#{found[0].name}"
            raise PartNeeded(line, [Part(one.name, "of cells" if one.of_cells else "of points") for one in found])
    if arrays:
        raise BadInput(
            f"{path}: has only {_listed(arrays)}, volsplat needs one number a voxel; save a component or the magnitude"
        )
    raise BadInput(f"{path}: has no data of its points or cells; save the grid again")


def parts_of_arrays(part: str, arrays: Sequence[NamedArray]) -> list[Part]:
    """What could be named in place of what is taken if nobody names an array; none where one is named or alone."""
    scalars = [one for one in _without_ghosts(arrays) if one.components == 1]
    return _told(scalars) if not part and len(scalars) > 1 else []


def ghosts_of(arrays: Sequence[AnyArray], read: Callable[[AnyArray], Reader], reads_whole: bool) -> Ghosts:
    """What tells which points and cells are hidden."""

    def reader(of_cells: bool) -> Reader | None:
        found = (one for one in arrays if one.name == GHOSTS and one.of_cells == of_cells)
        return next((read(one) for one in found if one.components == 1 and one.scalar_type == GHOST_TYPE), None)

    return Ghosts(reader(False), reader(True), reads_whole)


def _without_ghosts(arrays: Sequence[AnyArray]) -> list[AnyArray]:
    return [one for one in arrays if one.name != GHOSTS]


def _told(arrays: Sequence[NamedArray]) -> list[Part]:
    return [Part(f"{one.association}/{one.name}", "of cells" if one.of_cells else "of points") for one in arrays]


def _named(path: Path, part: str, arrays: Sequence[AnyArray]) -> AnyArray:
    named = [one for one in arrays if part in (one.name, f"{one.association}/{one.name}")]
    if not named:
        raise BadInput(f"{path}: has no array “{part}”; it has {_listed(arrays) or 'none'}")
    if named[0].components != 1:
        raise BadInput(
            f"{path}: “{part}” has {named[0].components} components, volsplat needs one number a voxel; "
            "save one component or the magnitude"
        )
    return named[0]


def _listed(arrays: Sequence[NamedArray]) -> str:
    """The names, with what is unusual of each."""
    told = []
    for one in arrays:
        unusual = [f"{one.components} components"] if one.components != 1 else []
        unusual += ["of cells"] if one.of_cells else []
        told.append(f"{one.name} ({', '.join(unusual)})" if unusual else one.name)
    return ", ".join(told)
