"""Images in HDF5 files of programs that say where these lie in a way of their own: VTK's, ITK's and Imaris'.

https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html, ITK's HDF5ImageIO, and
https://imaris.oxinst.com/support/imaris-file-format. Nothing here reads voxels.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart
from volsplat.mapshade_server.readers.arrays.array_volume import array_told
from volsplat.mapshade_server.readers.arrays.hdf5_file import h5py
from volsplat.mapshade_server.readers.reading.grids import checked_geometry, grid_of_cells, refuse_vectors
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.vtk_ghosts import GHOST_TYPE, GHOSTS
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.length_units import length_unit

VTK_GROUP = "VTKHDF"
ITK_IMAGE = "ITKImage/0"
IMARIS_DATA = re.compile(r"/?DataSet/ResolutionLevel (\d+)/TimePoint (\d+)/Channel (\d+)/Data")


@dataclass(frozen=True)
class Hdf5Image:
    """A dataset by its path, where its voxels lie, and what is known of them; `frame` is its first index, if it has.

    `point_ghosts` and `cell_ghosts` are the paths of what tells which of VTK's points and cells are hidden, "" if
    nothing does.
    """

    path: str
    format: str
    geometry: Geometry
    density_name: str
    frame: int | None = None
    unit: str = ""
    anatomical: bool = False
    parts: Sequence[Part] = ()  # that could be taken in its place
    point_ghosts: str = ""
    cell_ghosts: str = ""
    of_cells: bool = False

    def selection(self, box: Box) -> tuple[int | slice, ...]:
        """What to index the dataset with to have the voxels of `box`, as (k, j, i)."""
        return box.slices() if self.frame is None else (self.frame, *box.slices())


def image_in(part: ArrayPart, file: Any) -> Hdf5Image | None:
    """The image that is meant, None if the file is of no such program or something else in it is named.

    Raises BadInput if one must be chosen, and if the file does not state its place as it should.
    """
    try:
        if VTK_GROUP in file:
            return _of_vtk(part, file[VTK_GROUP])
        if ITK_IMAGE in file and _means(part, f"/{ITK_IMAGE}/VoxelData"):
            return _of_itk(part, file[ITK_IMAGE])
        if "DataSetInfo/Image" in file and (not part.path or IMARIS_DATA.fullmatch(part.path)):
            return _of_imaris(part, file)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{part.place}: does not tell where its voxels lie ({error}); save or fetch it again") from None
    return None


def _means(part: ArrayPart, path: str) -> bool:
    return path.startswith(f"/{part.path.strip('/')}".rstrip("/"))


def _numbers(values: Any, count: int) -> list[float]:
    numbers: list[float] = np.asarray(values, np.float64).ravel().tolist()
    if len(numbers) != count:
        raise ValueError(f"{len(numbers)} numbers instead of {count}")
    return numbers


def _text(value: Any) -> str:
    """A text attribute, also one of single letters, as Imaris writes them."""
    letters = np.asarray(value).ravel().tolist()
    parts = [one.decode(errors="replace") if isinstance(one, bytes) else str(one) for one in letters]
    return "".join(parts).strip("\0 ")


# -- VTK


def _of_vtk(part: ArrayPart, group: Any) -> Hdf5Image:
    kind = _text(group.attrs["Type"])
    if kind != "ImageData":
        raise BadInput(f"{part.place}: holds VTK's {kind}, volsplat reads ImageData; resample it to an image")
    arrays = {
        one.name: one
        for name in ("PointData", "CellData")
        for one in group.get(name, {}).values()
        if isinstance(one, h5py().Dataset)
    }
    steps = int(group["Steps"].attrs["NSteps"]) if "Steps" in group else None
    part.check_known(() if steps is None else ("t",))
    points = _vtk_grid(part, group)
    cells = grid_of_cells(Path(part.place), points)
    named = {name: one for name, one in arrays.items() if not name.endswith(f"/{GHOSTS}")}
    dataset = _vtk_array(part, named, 3 if steps is None else 4)
    others = [one for one in named.values() if len(one.shape) == dataset.ndim]
    of_cells = dataset.parent.name.endswith("CellData")
    geometry = cells if of_cells else points
    if tuple(dataset.shape[-3:]) != geometry.dims[::-1]:
        shown = " x ".join(str(n) for n in dataset.shape)
        raise BadInput(f"{part.whole}: {dataset.name} is {shown}, not as its extent has it; save it again")
    format_name = "VTKHDF image, values of cells" if of_cells else "VTKHDF image"
    frame = None if steps is None else _chosen(part, "t", dataset.shape[0], [])
    parts = [array_told(one.name, one.shape) for one in others] if _is_silent(part) and len(others) > 1 else ()
    point_ghosts, cell_ghosts = (
        _ghosts(arrays, f"{group.name}/{name}", (*dataset.shape[:-3], *grid.dims[::-1]))
        for name, grid in (("PointData", points), ("CellData", cells))
    )
    return Hdf5Image(
        dataset.name,
        format_name,
        geometry,
        dataset.name.rpartition("/")[2],
        frame,
        parts=parts,
        point_ghosts=point_ghosts,
        cell_ghosts=cell_ghosts,
        of_cells=of_cells,
    )


def _ghosts(arrays: Mapping[str, Any], group: str, shape: tuple[int, ...]) -> str:
    """The path of what tells which points or cells are hidden, "" if nothing does."""
    found = arrays.get(f"{group}/{GHOSTS}")
    return found.name if found is not None and (found.shape, found.dtype.name) == (shape, GHOST_TYPE) else ""


def _is_silent(part: ArrayPart) -> bool:
    """Whether nobody named anything in the file."""
    return not (part.path or part.options)


def _vtk_grid(part: ArrayPart, group: Any) -> Geometry:
    """The grid of the points. Origin is the place of index 0, whether or not the extent holds that."""
    i0, i1, j0, j1, k0, k1 = (int(n) for n in _numbers(group.attrs["WholeExtent"], 6))
    steps, origin = _numbers(group.attrs["Spacing"], 3), _numbers(group.attrs["Origin"], 3)
    direction = np.array(_numbers(group.attrs.get("Direction", np.eye(3)), 9)).reshape(3, 3)
    matrix = direction * steps
    first = matrix @ (i0, j0, k0) + origin
    return checked_geometry(Path(part.place), (i1 - i0 + 1, j1 - j0 + 1, k1 - k0 + 1), matrix, first)


def _vtk_array(part: ArrayPart, arrays: dict[str, Any], axes: int) -> Any:
    """The array that the part names by path or name, else the active scalars or the only array of single numbers."""
    scalars = [one for one in arrays.values() if len(one.shape) == axes]
    wanted = part.path.rpartition("/")[2] if part.path not in ("", f"/{VTK_GROUP}", VTK_GROUP) else ""
    named = [one for path, one in arrays.items() if part.path.strip("/") == path.strip("/")]
    named = named or [one for one in arrays.values() if one.name.rpartition("/")[2] == wanted]
    active = [one for one in scalars if _text(one.attrs.get("Attribute", "")) == "Scalars"]
    found = named if wanted else active if len(active) == 1 else scalars
    listed = ", ".join(one.name.removeprefix(f"/{VTK_GROUP}/") for one in (scalars if scalars else arrays.values()))
    if not found:
        raise BadInput(f"{part.place}: has no array of single numbers “{wanted}”; it has {listed or 'none'}")
    if len(found) > 1:
        line = f"{part.place}: holds {listed}; choose one, as in {part.place}#{found[0].name}"
        raise PartNeeded(line, [array_told(one.name, one.shape) for one in found])
    if found[0] not in scalars:
        refuse_vectors(Path(part.place), f"{found[0].shape[-1]} components a voxel in {found[0].name}")
    return found[0]


# -- ITK


def _of_itk(part: ArrayPart, group: Any) -> Hdf5Image:
    """Rows of `Directions` are where i, j, k lead; physical axes are LPS, lengths mm, as ITK has them.

    A fourth axis is that of a series.
    """
    dims = tuple(int(n) for n in group["Dimension"][:])
    part.check_known(("t",) if len(dims) == 4 else ())
    data = group["VoxelData"]
    if len(dims) not in (3, 4):
        what = "a 2-D image" if len(dims) == 2 else f"an image of {len(dims)} axes"
        raise BadInput(f"{part.place}: {what}, volsplat needs a volume of three; export one")
    if data.ndim == len(dims) + 1 and tuple(data.shape[:-1]) == dims[::-1]:
        refuse_vectors(Path(part.place), f"{data.shape[-1]} components a voxel")
    if tuple(data.shape) != dims[::-1]:
        raise ValueError(f"Dimension {dims} against voxels {data.shape}")
    axes = len(dims)
    directions = np.array(_numbers(group["Directions"][:], axes * axes)).reshape(axes, axes)[:3, :3]
    steps, origin = _numbers(group["Spacing"][:], axes)[:3], _numbers(group["Origin"][:], axes)[:3]
    geometry = checked_geometry(Path(part.place), dims[:3], directions.T * steps, origin)
    frame = _chosen(part, "t", dims[3], []) if axes == 4 else None
    return Hdf5Image(data.name, "ITK image in HDF5", geometry, "", frame, unit="mm", anatomical=True)


# -- Imaris


def _of_imaris(part: ArrayPart, file: Any) -> Hdf5Image:
    """The sizes beside the voxels count, since these are padded to whole chunks; extents are the outer faces."""
    part.check_known(("level", "t", "c"))
    named = IMARIS_DATA.fullmatch(part.path)
    levels = _numbered(file["DataSet"], "ResolutionLevel")
    level = int(named[1]) if named else _chosen(part, "level", levels, [], 0)
    moments = file[f"DataSet/ResolutionLevel {level}"]
    time = int(named[2]) if named else _chosen(part, "t", _numbered(moments, "TimePoint"), [])
    channels = moments[f"TimePoint {time}"]
    info = file["DataSetInfo"]
    names = [
        _text(info[f"Channel {n}"].attrs.get("Name", "")) if f"Channel {n}" in info else ""
        for n in range(_numbered(channels, "Channel"))
    ]
    channel = int(named[3]) if named else _chosen(part, "c", len(names), names)
    group, image = channels[f"Channel {channel}"], info["Image"].attrs
    dims = tuple(int(_text(group.attrs[f"ImageSize{axis}"])) for axis in "XYZ")
    if any(size > held for size, held in zip(dims[::-1], group["Data"].shape, strict=True)):
        raise ValueError(f"a size of {dims} in {group['Data'].shape} voxels")
    ends = [(float(_text(image[f"ExtMin{n}"])), float(_text(image[f"ExtMax{n}"]))) for n in range(3)]
    steps = [(high - low) / size for (low, high), size in zip(ends, dims, strict=True)]
    origin = [low + step / 2 for (low, _), step in zip(ends, steps, strict=True)]
    unit = _text(image.get("Unit", "um"))
    known = length_unit(unit)
    return Hdf5Image(
        path=group["Data"].name,
        format=f"Imaris, level {level} of {levels}",
        geometry=checked_geometry(Path(part.place), dims, np.diag(steps), origin),
        density_name=names[channel] if channel < len(names) else "",
        unit=known.symbol if known else unit,
        parts=() if named or "level" in part.options else _levels(part, file["DataSet"], levels, time, channel),
    )


def _levels(part: ArrayPart, data: Any, count: int, time: int, channel: int) -> list[Part]:
    """The resolutions of what is chosen already, the finest first; none if there is one."""
    if count == 1:
        return []
    told = []
    for level in range(count):
        path = f"ResolutionLevel {level}/TimePoint {time}/Channel {channel}"
        sizes = [_text(data[path].attrs[f"ImageSize{axis}"]) for axis in "XYZ"]
        told.append(Part(part.with_option(f"level={level}"), f"level {level}, {' x '.join(sizes)}"))
    return told


def _numbered(group: Any, what: str) -> int:
    """How many members of a group are called so and numbered from 0."""
    return sum(re.fullmatch(rf"{what} \d+", name) is not None for name in group)


def _chosen(part: ArrayPart, key: str, count: int, names: Sequence[str], default: int | None = None) -> int:
    """The number that the option says, else the default or the only one. Raises BadInput if it must be said."""
    said = part.whole_number(key)
    if said is None and default is None and count > 1:
        shown = ", ".join(f"{key}={n} “{name}”" for n, name in enumerate(names) if name) or f"{key}=0 to {count - 1}"
        line = f"{part.place}: holds {count} volumes, {shown}; choose, as in {part.advice(f'{key}=0')}"
        told = [name or f"{key} {n} of 0 to {count - 1}" for n, name in enumerate(names or [""] * count)]
        raise PartNeeded(line, [Part(part.with_option(f"{key}={n}"), word) for n, word in enumerate(told)])
    number = default or 0 if said is None else said
    if number >= count:
        raise part.wrong(key, f"is beyond the last, {key}={count - 1}")
    return number
