"""An array of a file as a volume: formats differ in how they find it and read it."""

from collections.abc import Callable, Sequence
from typing import Any

from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.array_grid import ArrayGrid
from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart
from volsplat.mapshade_server.readers.arrays.array_values import ArrayValues
from volsplat.mapshade_server.readers.reading.part_options import listed
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.volume_files import VolumeFile
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, Voxels, no_room
from volsplat.protocol.description.volume import Box, Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

Pick = Callable[[tuple[int | slice, ...]], NDArray[Any]]  # gives what indexing an array would give
ONE_CHUNK = "all its voxels are in one chunk"


def array_volume(
    part: ArrayPart,
    format_name: str,
    grid: ArrayGrid,
    values: ArrayValues,
    pick: Pick,
    *,
    density_name: str,
    value_unit: str = "",
    warnings: Sequence[str] = (),
    chunk: Index = (1, 1, 1),
    why_whole: str = "",
    files: Callable[[], Sequence[VolumeFile]] = tuple,
    parts: Sequence[Part],
) -> OpenedVolume:
    """The reader for an array whose numbers `pick` reads; `warnings` are those that its grid does not have."""
    description = VolumeDescription(
        name=part.place.rpartition("/")[2],
        format=format_name,
        geometry=grid.geometry,
        scalar_type=values.scalar_type,
        unit=grid.unit,
        value_unit=value_unit,
        axes=grid.axes,
        up=grid.up,
        warnings=(*(warning for warning in warnings if warning), *grid.warnings),
        density_name=density_name,
        reads_sub_cubes=not why_whole,
        chunk=chunk,
        why_whole=why_whole,
    )

    def read(box: Box) -> Voxels:
        try:
            return values.of(pick(grid.selection(box)))
        except MemoryError:
            raise no_room(part.place) from None

    return OpenedVolume(description, read, files, parts=parts)


def is_one_chunk(grid: ArrayGrid, shape: Sequence[int], chunks: Sequence[int] | None) -> bool:
    """Whether the whole grid lies in one of the array's chunks."""
    return chunks is not None and all(
        chunk >= length for chunk, length, index in zip(chunks, shape, grid.indices, strict=True) if index is None
    )


def array_told(name: str, shape: Sequence[int]) -> Part:
    """An array for a person to choose."""
    return Part(name, " x ".join(map(str, shape)) or "a number")


def shown(parts: Sequence[Part]) -> list[str]:
    """As a line lists them."""
    return [f"{one.part} ({one.told})" for one in parts]


def choose_one(part: ArrayPart, where: str, parts: Sequence[Part]) -> BadInput:
    """What to say if `where` holds several arrays."""
    line = f"{where}: holds {listed(shown(parts))}; choose one, as in {part.place}#{parts[0].part}"
    return PartNeeded(line, parts)


def is_minc(part: ArrayPart) -> BadInput:
    return BadInput(f"{part.place}: is MINC, whose values are scaled by slice; convert it to NIfTI, as mnc2nii does")
