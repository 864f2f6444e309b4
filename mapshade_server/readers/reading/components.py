"""Several numbers a voxel: which one of them is drawn, or the magnitude of the vector that they are.

One rule for VTK's files, NRRD, MetaImage and NIfTI: two or three numbers are x, y and z of a vector, whose magnitude
is drawn if nobody chooses. More are numbered from 0, and one must be chosen. Three or four bytes are colours, as VTK
and ITK have them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np

from volsplat.mapshade_server.readers.reading.part_options import chosen_frame, listed
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.volume_reader import ReadBox, Voxels, by_sheets
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

LETTERS = "xyz"
MAGNITUDE = "magnitude"
MOST_NUMBERED = 1024


@dataclass(frozen=True)
class Component:
    """What is drawn of `count` numbers a voxel: the one of this number, None for the magnitude of all."""

    count: int = 1
    number: int | None = 0

    @property
    def taken(self) -> range:
        """The numbers of the components that must be read."""
        return range(self.count) if self.number is None else range(self.number, self.number + 1)

    def value_name(self, array: str = "") -> str:
        """What the values are called, of an array of this name."""
        if self.count == 1:
            return array
        shown = MAGNITUDE if self.number is None else f"component {_names(self.count)[self.number]}"
        return f"{array}, {shown}" if array else shown

    def scalar_type(self, stored: str) -> str:
        return np.result_type(stored, np.float32).name if self.number is None else stored

    def of(self, components: Iterable[Voxels], stored: str) -> Voxels:
        """What is drawn, of those that are `taken`, which are of the type that is stored."""
        if self.number is not None:
            (only,) = components
            return only
        with np.errstate(over="ignore", invalid="ignore"):
            squares = reduce(np.add, (np.square(one, dtype=np.float64) for one in components))
            return np.sqrt(squares, out=squares).astype(self.scalar_type(stored))

    def of_interleaved(self, path: Path, stored: str, every: ReadBox) -> ReadBox:
        """Reads what is drawn if a voxel's numbers lie side by side, as `every` reads them: along i."""
        if self.count == 1:
            return every

        def taken(box: Box) -> Iterable[Voxels]:
            (i0, j0, k0), (i1, j1, k1) = box
            numbers = every(Box((i0 * self.count, j0, k0), (i1 * self.count, j1, k1)))
            return (numbers[..., n :: self.count] for n in self.taken)

        return by_sheets(path, self.scalar_type(stored), lambda box: self.of(taken(box), stored), self.count)

    def of_separate(self, path: Path, stored: str, each: Sequence[ReadBox]) -> ReadBox:
        """Reads what is drawn if each component lies apart, as `each` of those that are `taken` reads it."""
        if self.number is not None:
            (only,) = each
            return only
        return by_sheets(
            path, self.scalar_type(stored), lambda box: self.of((read(box) for read in each), stored), self.count
        )


def are_colours(count: int, scalar_type: str) -> bool:
    return count in (3, 4) and scalar_type == "uint8"


def has_magnitude(count: int) -> bool:
    return 1 < count <= len(LETTERS)


def parts_of_components(count: int, before: str = "") -> list[Part]:
    """All that could be named of so many components; `before` is what stands in front of each."""
    magnitude = [Part(before + MAGNITUDE, MAGNITUDE)] if has_magnitude(count) else []
    return magnitude + [Part(before + name, f"component {name} of {count}") for name in _names(count)]


def chosen_component(path: Path, said: str | None, count: int, before: str = "") -> Component:
    """The component that is named by its letter or number, or the magnitude; `said` is None if nothing is named.

    `before` is what stands in front of it in the volume's name. Raises BadInput if it must be named and is not.
    """
    if count > MOST_NUMBERED:
        raise BadInput(
            f"{path}: has {count} components a voxel, 0 to {count - 1}, volsplat reads no more than {MOST_NUMBERED}; "
            "export one component or the magnitude"
        )
    parts, names = parts_of_components(count, before), _names(count)
    if has_magnitude(count) and said in (None, MAGNITUDE):
        return Component(count, None)
    if said in names:
        return Component(count, names.index(said))
    shown = listed([one.part for one in parts])
    if said is None:
        line = f"{path}: has {count} components a voxel, volsplat needs one number; choose one, as in {path}#{before}0"
        raise PartNeeded(line, parts)
    raise BadInput(f"{path}: has no component “{before}{said}”; it has {shown}")


class ChosenVolume(NamedTuple):
    """A frame of a series, what it is called, what is drawn of it, and what else could be named where nothing is."""

    frame: int
    name: str
    component: Component
    parts: list[Part]


def chosen_volume(path: Path, part: str, frames: int, count: int) -> ChosenVolume:
    """What `part` names of a file of numbered frames: `3`, `x` of a single frame, or `3,x`. Raises BadInput."""
    if count == 1:
        return ChosenVolume(*chosen_frame(path, part, frames), Component(), [])
    frame_said, comma, said = part.partition(",") if frames > 1 else ("", part, part)
    frame, _ = chosen_frame(path, frame_said, frames)
    before = f"{frame_said}," if frame_said else ""
    component = chosen_component(path, said if comma else None, count, before)
    name = f"{path.name}#{part}" if part else path.name
    return ChosenVolume(frame, name, component, [] if comma else parts_of_components(count, before))


def _names(count: int) -> list[str]:
    return list(LETTERS[:count]) if has_magnitude(count) else [str(n) for n in range(count)]
