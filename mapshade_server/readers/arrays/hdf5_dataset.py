"""Datasets in HDF5 files, and so in NetCDF-4, NeXus and MATLAB 7.3 files, through h5py: by path, by hyperslab.

The grid's spacing comes from the axes' dimension scales, which are NetCDF's coordinate variables, from NeXus's axes,
or from element_size_um, which Fiji and ilastik write; the values' meaning from the CF conventions.
"""

import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.array_grid import LETTERS, MOST_COMPONENTS, ArrayAxis, array_grid
from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart, array_part
from volsplat.mapshade_server.readers.arrays.array_values import Attributes, cf_values, plain_values, text_attribute
from volsplat.mapshade_server.readers.arrays.array_volume import (
    ONE_CHUNK,
    Pick,
    array_told,
    array_volume,
    choose_one,
    is_minc,
    is_one_chunk,
    shown,
)
from volsplat.mapshade_server.readers.arrays.cf_coordinates import Coordinates, coordinates_of, warnings_of
from volsplat.mapshade_server.readers.arrays.hdf5_chunks import check_chunks, read_selection
from volsplat.mapshade_server.readers.arrays.hdf5_file import h5py, hdf5_file
from volsplat.mapshade_server.readers.arrays.hdf5_images import Hdf5Image, image_in
from volsplat.mapshade_server.readers.arrays.hdf5_names import (
    MOST_OBJECTS,
    FilesByLinks,
    behind,
    check_files_beside,
    check_way,
    files_beside,
    links_out,
    lost_links,
    refuse_outside,
    soft_links,
)
from volsplat.mapshade_server.readers.arrays.hdf5_sources import value_files
from volsplat.mapshade_server.readers.reading.natural_order import natural_order
from volsplat.mapshade_server.readers.reading.part_options import listed
from volsplat.mapshade_server.readers.reading.parts import Part
from volsplat.mapshade_server.readers.reading.volume_files import VolumeFile, disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat, no_room
from volsplat.mapshade_server.readers.reading.vtk_ghosts import Ghosts, Reader
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

MAGIC = b"\x89HDF\r\n\x1a\n"
USER_BLOCKS = (0, 512, 1024, 2048)  # bytes before the magic, which belong to others
NETCDF_FILL = 9.969209968386869e36  # of floats, where nothing was written
ONLY_A_NAME = "This is a netCDF dimension but not a netCDF variable"
# No other attributes are read: HDF5 crashes on damaged ones, and a file may have thousands.
ATTRIBUTES = (
    "scale_factor add_offset _FillValue missing_value valid_range valid_min valid_max _Unsigned "
    "units long_name standard_name axis positive NAME "
    "default signal axes element_size_um MATLAB_class"
).split()
CHANNELS = ("c", "channel", "channels")
SIEVE_BYTES = 1 << 16  # that HDF5 reads at least if a dataset is not in chunks


def recognises(head: bytes) -> bool:
    return any(head[at : at + len(MAGIC)] == MAGIC for at in USER_BLOCKS)


def open_hdf5(path: Path, part: str) -> OpenedVolume:
    """The reader for a dataset. Raises BadInput if none is a volume, or the person must choose one."""
    with _opened(path) as file:
        refuse_outside(path)
        chosen = array_part(path, part, lambda name: _has(file, name))
        if (image := image_in(chosen, file)) is not None:
            return _image(chosen, image, file)
        name, dataset, parts = _dataset(chosen, file)
        chosen = chosen._replace(path=name)
        _check_readable(chosen, dataset)
        lies = value_files(path, name)
        attributes = _attributes(dataset)
        values = cf_values(chosen.whole, dataset.dtype, {**_never_written(dataset), **attributes})
        coordinates = _axes(dataset, attributes, _groups_around(path, name, file, dataset))
        grid = array_grid(chosen, [one.axis for one in coordinates])
        chunk_items = SIEVE_BYTES // dataset.dtype.itemsize
        return array_volume(
            chosen,
            f"HDF5 dataset {name}",
            grid,
            values,
            _picks(path, name),
            density_name=text_attribute(attributes, "long_name") or name.rpartition("/")[2],
            value_unit=text_attribute(attributes, "units"),
            warnings=[*_told_missing(dataset, lies.missing), *warnings_of(coordinates, grid)],
            chunk=grid.chunk(dataset.chunks, chunk_items),
            why_whole=ONE_CHUNK if is_one_chunk(grid, dataset.shape, dataset.chunks) else "",
            files=_files(lies.files),
            parts=parts,
        )


def _files(places: Sequence[Path]) -> Callable[[], Sequence[VolumeFile]]:
    files = disk_files(places)
    return lambda: files


def _picks(path: Path, name: str) -> Pick:
    """What reads from a dataset; the file is open only while it is read."""

    def pick(selection: tuple[int | slice, ...]) -> NDArray[Any]:
        with _opened(path) as file:
            return read_selection(file[name], selection)

    return pick


def _image(part: ArrayPart, image: Hdf5Image, file: Any) -> OpenedVolume:
    """The reader for an image that says its place in its program's way."""
    for path in filter(None, (image.point_ghosts, image.cell_ghosts, image.path)):
        part = part._replace(path=path)
        _check_readable(part, file[path])
    dataset = file[image.path]
    paths = filter(None, (image.path, image.point_ghosts, image.cell_ghosts))
    lie = [value_files(Path(part.place), path) for path in paths]
    values = plain_values(part.whole, dataset.dtype)
    pick = _picks(Path(part.place), image.path)
    ghosts = Ghosts(_ghosts(part, image, image.point_ghosts), _ghosts(part, image, image.cell_ghosts))
    scalar_type, read = ghosts.shown(
        values.scalar_type, lambda box: values.of(pick(image.selection(box))), image.geometry.dims, image.of_cells
    )
    description = VolumeDescription(
        name=Path(part.place).name,
        format=image.format,
        geometry=image.geometry,
        scalar_type=scalar_type,
        unit=image.unit,
        anatomical=image.anatomical,
        density_name=image.density_name,
        warnings=tuple(_told_missing(dataset, lie[0].missing)),
    )
    files = _files([place for one in lie for place in one.files])
    return OpenedVolume(description, read, files, parts=image.parts)


def _ghosts(part: ArrayPart, image: Hdf5Image, path: str) -> Reader | None:
    pick = _picks(Path(part.place), path)
    return (lambda dims: lambda box: pick(image.selection(box))) if path else None


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The open file; what h5py raises within becomes BadInput."""
    try:
        with hdf5_file(path) as file:
            yield file
    except MemoryError:
        raise no_room(path) from None
    except (OSError, RuntimeError, LookupError, TypeError, ValueError) as error:
        raise BadInput(f"{path}: {_reason(error)}; check or fetch the file again") from None


def _reason(error: Exception) -> str:
    """What HDF5 says, without what h5py says around it."""
    text = " ".join(str(error).replace('"', "").split()).strip("'")
    if match := re.search(r"truncated file: eof = (\d+).*stored_eof = (\d+)", text):
        return f"is truncated, it has {match[1]} of its {match[2]} bytes"
    match = re.fullmatch(r"[^()]*\((.*)\)", text)
    return f"HDF5 cannot read it ({match[1] if match else text})"


def _dataset(part: ArrayPart, file: Any) -> tuple[str, Any, list[Part]]:
    """The dataset that the part names, else the only one with enough axes, or the file's default, with the others.

    Its path is that in this file: in another one, to which a link may lead, it has a name of its own.
    """
    if "minc-2.0" in file:
        raise is_minc(part)
    check_way(file, part.path)
    if part.path and part.path not in file:
        raise BadInput(f"{part.place}: has no “{part.path}”; it holds {listed(shown(_told(_arrays(file, ''))))}")
    root = "/" + part.path.strip("/")
    found = behind(file, root)
    if found is None:
        raise _leads_nowhere(part, file)
    if isinstance(found, h5py().Dataset):
        return root, found, []
    arrays = _arrays(found, root.rstrip("/"))
    default, plotted = _nexus_default(found, root)
    if behind(file, default) == plotted:  # where its axes are
        arrays = {default if one == plotted else path: one for path, one in arrays.items()}
    volumes = {path: array for path, array in arrays.items() if len(array.shape) >= 3 and array.dtype.kind in "biuf"}
    if len(volumes) == 1:
        return *volumes.popitem(), []
    if not volumes:
        held = listed([*shown(_told(arrays)), *lost_links(found)])
        raise BadInput(f"{part.whole}: holds no dataset with three axes of numbers; it holds {held}")
    for path, array in volumes.items():
        if array == plotted:
            return path, array, _told(volumes)
    raise choose_one(part, part.whole, _told(volumes))


def _has(file: Any, path: str) -> bool:
    check_way(file, path)
    return bool(path) and path in file


def _leads_nowhere(part: ArrayPart, file: Any) -> BadInput:
    link = file.get(part.path, getlink=True)
    if isinstance(link, h5py().ExternalLink):
        where = f"{link.path} of {link.filename}, which is not there, or lacks that"
        return BadInput(f"{part.whole}: is a link to {where}; put that file beside it, or fetch it again")
    if isinstance(link, h5py().SoftLink):
        return BadInput(f"{part.whole}: is a link to {link.path}, which leads nowhere; choose another part")
    return BadInput(f"{part.whole}: is damaged; check or fetch the file again")


def _arrays(group: Any, root: str) -> dict[str, Any]:
    """All datasets in the group at `root` and its groups, each by one path, and those to which links out of it lead."""
    found: dict[Any, str] = {}
    left = MOST_OBJECTS
    to_look_at, seen = deque([(root, group)]), {group}

    def look(path: str, one: Any) -> bool | None:
        nonlocal left
        left -= 1
        if isinstance(one, h5py().Dataset) and one.shape:
            found.setdefault(one, path)
        return True if left <= 0 else None

    with FilesByLinks() as files:
        while to_look_at and left > 0:
            way, at = to_look_at.popleft()
            at.visititems(lambda inner, one, way=way: look(f"{way}/{inner}", one))
            soft = soft_links(at, MOST_OBJECTS) if at != at.file["/"] else []  # nothing lies outside of a whole file
            for inner in (*(name for name, _ in links_out(at, MOST_OBJECTS)), *soft):
                one = behind(at, inner, files)
                look(f"{way}/{inner}", one)
                if isinstance(one, h5py().Group) and one not in seen:
                    seen.add(one)
                    to_look_at.append((f"{way}/{inner}", one))
    return {path: one for one, path in found.items()}


def _told(arrays: Mapping[str, Any]) -> list[Part]:
    return [array_told(path, arrays[path].shape) for path in sorted(arrays, key=natural_order)]


def _nexus_default(group: Any, root: str) -> tuple[str, Any]:
    """What NeXus says to plot in the group at `root`, and its path; None if it says nothing."""
    attributes, passed = _attributes(group), set[Any]()
    while group not in passed:  # one may name itself
        passed.add(group)
        name = text_attribute(attributes, "default")
        if name and isinstance(inner := behind(group, name), h5py().Group):
            group, root, attributes = inner, _below(root, name), _attributes(inner)
    signal = text_attribute(attributes, "signal")
    return _below(root, signal), behind(group, signal) if signal else None


def _below(path: str, name: str) -> str:
    steps = (name if name.startswith("/") else f"{path}/{name}").split("/")
    return "/" + "/".join(step for step in steps if step not in ("", "."))


def _check_readable(part: ArrayPart, dataset: Any) -> None:
    """Raises BadInput if nothing was ever written, by a filter that is not installed, or in absurd chunks."""
    creation = dataset.id.get_create_plist()
    for number, _, _, name in (creation.get_filter(n) for n in range(creation.get_nfilters())):
        if not h5py().h5z.filter_avail(number):
            filter_name = name.decode(errors="replace") or "unnamed"
            raise BadInput(
                f"{part.whole}: is compressed by HDF5's filter {number} ({filter_name}), which is not installed; "
                f"convert it, as in h5repack -f GZIP=4 {Path(part.place).name} NEW.h5"
            )
    check_chunks(part.whole, dataset)
    check_files_beside(dataset)
    if not (dataset.is_virtual or dataset.external or dataset.id.get_storage_size()):
        raise BadInput(f"{part.whole}: no voxel of it was ever written; fetch or export it again")


def _told_missing(dataset: Any, missing: list[str]) -> list[str]:
    """Of files that should hold its voxels, and are not there or do not. Raises BadInput if none does."""
    if not missing:
        return []
    every = len(files_beside(dataset))
    if len(missing) == every:
        own, files = dataset.file.filename, listed(missing)
        raise BadInput(f"{own}: its voxels are in files that are not there, or lack them: {files}; put them beside it")
    told = f"{len(missing)} of {every} files with its voxels are not there, or lack them ({listed(missing)})"
    return [f"{told}: {dataset.fillvalue} is shown instead"]


def _attributes(one: Any) -> Attributes:
    """Those attributes that are texts, numbers, or lists of these; of an array of one, that one."""
    found: dict[str, Any] = {}
    for key in ATTRIBUTES:
        if key not in one.attrs:
            continue
        try:
            value = np.asarray(one.attrs[key])
        except (OSError, RuntimeError, TypeError, ValueError):  # of a type that h5py does not know
            continue
        if value.dtype.kind in "biufSUO":
            plain = [n.decode(errors="replace") if isinstance(n, bytes) else n for n in value.ravel().tolist()]
            found[key] = plain[0] if len(plain) == 1 else plain
    return found


def _never_written(dataset: Any) -> dict[str, Any]:
    """What NetCDF puts where nothing was written, without an attribute that says so."""
    if dataset.dtype.name in ("float32", "float64") and dataset.fillvalue == dataset.dtype.type(NETCDF_FILL):
        return {"missing_value": NETCDF_FILL}
    return {}


class _Group(NamedTuple):
    """Of a file, by a path there: h5py may name it by one that leads to it from another file."""

    group: Any
    file: Path
    path: str


def _groups_around(path: Path, name: str, file: Any, dataset: Any) -> list[_Group]:
    """The group in which a dataset is named, and that of another file in which it lies, if a link leads there."""
    where, _, _ = name.rpartition("/")
    groups = [_Group(file[where or "/"], path, where)]
    with suppress(KeyError):
        lies = dataset.parent
        if lies != groups[0].group and behind(lies, dataset.name.rpartition("/")[2]) == dataset:
            groups.append(_Group(lies, Path(lies.file.filename), lies.name.rstrip("/")))
    return groups


def _axes(dataset: Any, attributes: Attributes, around: Sequence[_Group]) -> list[Coordinates]:
    """The dataset's axes, by what is the first to describe them all."""
    scales = [_scale(dataset, n) for n in range(dataset.ndim)]
    for n, (group, name) in enumerate(_nexus_axes(dataset.ndim, around)):
        if scales[n].axis == ArrayAxis(dataset.shape[n]) and name in group.group:
            if isinstance(variable := behind(group.group, name), h5py().Dataset):
                scales[n] = _variable(dataset.shape[n], name, variable, (group.file, _below(group.path, name)))
    sizes = attributes.get("element_size_um")
    if isinstance(sizes, list) and len(sizes) == 3 and dataset.ndim >= 3:
        end = dataset.ndim - _ends_in_components([one.axis for one in scales])
        for n, size, letter in zip(range(end - 3, end), sizes, reversed(LETTERS), strict=True):
            axis = replace(scales[n].axis, step=float(size), first=0.0, unit="µm", along=letter)
            scales[n] = Coordinates(axis)
    if "MATLAB_class" in attributes and dataset.ndim == 3:  # written with the order of axes turned round
        for n, letter in enumerate("zxy"):  # pages, columns along x, rows along y
            scales[n] = Coordinates(replace(scales[n].axis, name=letter, along=letter))
    return scales


def _ends_in_components(axes: Sequence[ArrayAxis]) -> bool:
    """Whether the last of more than three axes holds components, as ilastik's channels do."""
    last = axes[-1]
    few = not last.name and last.length <= MOST_COMPONENTS
    return len(axes) > 3 and (few or last.name.lower() in CHANNELS)


def _scale(dataset: Any, n: int) -> Coordinates:
    """Axis `n` by its dimension scale or label."""
    dimension = dataset.dims[n]
    if len(dimension):
        scale = dimension[0]
        where = Path(scale.file.filename), scale.name
        return _variable(dataset.shape[n], scale.name.rpartition("/")[2], scale, where)
    return coordinates_of(dataset.shape[n], dimension.label, None, {})


def _variable(length: int, name: str, variable: Any, where: tuple[Path, str]) -> Coordinates:
    """`where` it is found: a file, and a path there."""
    attributes = _attributes(variable)
    if text_attribute(attributes, "NAME").startswith(ONLY_A_NAME) or variable.ndim != 1:
        return coordinates_of(length, name, None, {})
    fits = variable.shape[0] in (length, length + 1) and variable.dtype.kind in "iuf"
    return coordinates_of(length, name, (lambda: _numbers(length, variable, where)) if fits else None, attributes)


def _numbers(length: int, variable: Any, where: tuple[Path, str]) -> NDArray[Any]:
    """The coordinates in a variable, one for each index."""
    check_chunks(variable.name, variable)
    value_files(*where)  # which may be more than can be gone through
    numbers = read_selection(variable, (slice(None),))
    return numbers if len(numbers) == length else (numbers[1:] + numbers[:-1]) / 2  # NeXus may give the edges of bins


def _nexus_axes(count: int, around: Sequence[_Group]) -> list[tuple[_Group, str]]:
    """The datasets that NeXus says describe so many axes, by the first group that says so."""
    for group in around:
        if names := _attributes(group.group).get("axes"):
            listed = names if isinstance(names, list) else str(names).strip("[] ").replace(":", ",").split(",")
            return [(group, str(name).strip()) for name in listed[:count]]
    return []


FORMATS = (VolumeFormat("HDF5 dataset (.h5, .nxs)", open_hdf5, recognises),)
