"""Zarr arrays of version 2 and 3: in folders, zip files and, through fsspec, at URLs; read by chunks.

Images of OME-Zarr are placed by their metadata, one level of their pyramid at a time; arrays that xarray wrote by
their coordinate arrays. Other arrays are named by their path.
"""

import base64
import zipfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.array_grid import ArrayAxis, ArrayGrid, array_grid
from volsplat.mapshade_server.readers.arrays.array_values import cf_values, plain_values, text_attribute
from volsplat.mapshade_server.readers.arrays.array_volume import ONE_CHUNK, array_volume, is_one_chunk
from volsplat.mapshade_server.readers.arrays.cf_coordinates import Coordinates, coordinates_of, warnings_of
from volsplat.mapshade_server.readers.reading.bounded_unpacking import check_promise
from volsplat.mapshade_server.readers.reading.parts import PartNeeded, numbered
from volsplat.mapshade_server.readers.reading.volume_files import VolumeFile
from volsplat.mapshade_server.readers.reading.volume_reader import FolderFormat, OpenedVolume, VolumeFormat
from volsplat.mapshade_server.readers.zarr_arrays import zarr_place
from volsplat.mapshade_server.readers.zarr_arrays.ome_zarr import Json, level_axes
from volsplat.mapshade_server.readers.zarr_arrays.zarr_codecs import at_most, check_codecs
from volsplat.mapshade_server.readers.zarr_arrays.zarr_files import fetched_files, files_of_arrays
from volsplat.mapshade_server.readers.zarr_arrays.zarr_place import METADATA, ZarrPlace, one_line_errors
from volsplat.mapshade_server.readers.zarr_arrays.zarr_search import FoundArray, named_array
from volsplat.protocol.text.errors import BadInput

ZIP_MAGIC = b"PK\3\4"


def recognises_folder(folder: Path) -> bool:
    return folder.name.endswith(".zarr") or any((folder / name).exists() for name in METADATA)


def recognises_zip(head: bytes) -> bool:
    return head.startswith(ZIP_MAGIC) and any(name.encode() in head for name in METADATA)


def open_folder(path: Path, part: str) -> OpenedVolume:
    """The reader for an array in a folder. Raises BadInput if none is a volume or one must be chosen."""
    with one_line_errors(str(path)):
        found = named_array(part, zarr_place.folder(str(path)))
        root = Path(found.place.name)
        within = (root / found.array.path).rglob("*")
        _check_has_chunks(found, (entry.name for entry in within if entry.is_file()))
        return _reader(found, lambda: files_of_arrays(root, [found.array]))


def open_zip(path: Path, part: str) -> OpenedVolume:
    """The reader for an array in a zip file. Raises BadInput as open_folder does, and for zip bombs."""
    with one_line_errors(str(path)):
        found = named_array(part, zarr_place.zip_file(str(path)))
        with zipfile.ZipFile(path) as archive:
            members = [one for one in archive.infolist() if one.filename.startswith(found.array.path)]
        together = np.prod(found.array.shards or found.array.chunks, dtype=object) * found.array.dtype.itemsize
        zarr_place.check_sizes(str(path), members, 2 * int(together))
        _check_has_chunks(found, (Path(one.filename).name for one in members if not one.is_dir()))
        return _reader(found)


def open_url(url: str, part: str) -> OpenedVolume:
    """The reader for an array at a URL. Raises BadInput as open_folder does, and if nothing answers there."""
    place = url.rstrip("/")

    def files() -> Sequence[VolumeFile]:
        with one_line_errors(place):
            return fetched_files(found.place.name, found.array, lambda: zarr_place.file_system(place))

    with one_line_errors(place):
        found = named_array(part, zarr_place.remote(place))
        return _reader(found, files)


def _check_has_chunks(found: FoundArray, names: Iterable[str]) -> None:
    """Raises BadInput if no chunk at all is stored, and all voxels would be the fill value."""
    if all(name in METADATA for name in names):
        raise BadInput(f"{found.part.whole}: not one of its chunks is there; copy or fetch the whole Zarr again")


def _check_stored(whole: str, array: Any) -> None:
    """Raises BadInput for codecs that may do anything, and for chunks that are far more than the array."""
    check_codecs(whole, array)
    check_promise(whole, _chunk_bytes(array), array.nbytes)


def _chunk_bytes(array: Any) -> int:
    return int(np.prod(array.chunks, dtype=object)) * int(array.dtype.itemsize)


def _reader(found: FoundArray, files: Callable[[], Sequence[VolumeFile]] = tuple) -> OpenedVolume:
    part, array = found.part, found.array
    _check_stored(part.whole, array)
    attributes: Json = dict(array.attrs)
    if found.image is None:
        values = cf_values(part.whole, array.dtype, {**attributes, **_fill_value(array, attributes)})
        coordinates = _coordinates(found)
        text = f"Zarr version {array.metadata.zarr_format}"
    else:
        values = plain_values(part.whole, array.dtype)
        coordinates = [Coordinates(axis) for axis in level_axes(part, found.image, found.level, array.shape)]
        text = f"OME-Zarr {found.image.version}, level {found.level} of 0 to {len(found.image.paths) - 1}"
    levels = [] if found.named or part.options or found.image is None else numbered(len(found.image.paths), "level")
    try:
        grid = array_grid(part, [one.axis for one in coordinates])
    except PartNeeded as needed:  # of each level
        raise PartNeeded(str(needed), levels) if len(levels) > 1 else needed from None
    others = found.image.others if found.image is not None else 0
    also = f"the first of the {1 + others} images that its metadata describes is taken" if others else ""

    def pick(selection: tuple[int | slice, ...]) -> NDArray[Any]:
        with one_line_errors(part.place), at_most(_chunk_bytes(array)):
            return np.asarray(array[selection])

    return array_volume(
        part,
        text,
        grid,
        values,
        pick,
        density_name=_density_name(found, [one.axis for one in coordinates], grid, attributes),
        value_unit=text_attribute(attributes, "units"),
        warnings=[*warnings_of(coordinates, grid), also],
        chunk=grid.chunk(array.chunks),
        why_whole=ONE_CHUNK if is_one_chunk(grid, array.shape, array.chunks) else "",
        files=files,
        parts=levels,
    )


def _density_name(found: FoundArray, axes: list[ArrayAxis], grid: ArrayGrid, attributes: Json) -> str:
    """What an image's channel or an array is called."""
    if found.image is None:
        return text_attribute(attributes, "long_name") or found.part.path.rpartition("/")[2]
    channels = [n for axis, n in zip(axes, grid.indices, strict=True) if axis.name == "c" and n is not None]
    names = [name for n in channels for name in found.image.channels[n : n + 1] if name]
    return names[0] if names else ""


def _coordinates(found: FoundArray) -> list[Coordinates]:
    """The axes by their dimensions' names, and the arrays of these names beside the array, as xarray writes them."""
    array = found.array
    names = getattr(array.metadata, "dimension_names", None) or array.attrs.get("_ARRAY_DIMENSIONS")
    if not isinstance(names, list | tuple) or len(names) != len(array.shape):
        names = [None] * len(array.shape)
    beside = _nodes_beside(found)
    return [
        _coordinate(found, beside, length, name if isinstance(name, str) else "")
        for length, name in zip(array.shape, names, strict=True)
    ]


def _coordinate(found: FoundArray, nodes: Callable[[str], Any], length: int, name: str) -> Coordinates:
    beside: Any = nodes(name) if name else None
    if not (found.place.is_array(beside) and beside.shape == (length,) and beside.dtype.kind in "iuf"):
        return coordinates_of(length, name, None, {})
    _check_stored(found.part.whole, beside)

    def read() -> NDArray[Any]:
        with at_most(_chunk_bytes(beside)):
            return np.asarray(beside[:])

    return coordinates_of(length, name, read, dict(beside.attrs))


def _nodes_beside(found: FoundArray) -> Callable[[str], Any]:
    """What opens arrays in the group that holds the array, also if the array's own folder is the place."""
    place = found.place
    group, _, own_name = found.part.path.rpartition("/")
    if own_name:
        return lambda name: place.node(f"{group}/{name}")
    return partial(_node_above, place)


def _node_above(place: ZarrPlace, name: str) -> Any:
    with suppress(Exception):
        for above, _ in place.around():
            return above.node(name)
    return None


def _fill_value(array: Any, attributes: Json) -> dict[str, Any]:
    """What xarray stores for values that are not known, if it does not say so as NetCDF does."""
    fill = attributes.get("_FillValue")
    if isinstance(fill, str) and array.dtype.kind == "f":  # in version 3 the bytes of a double, in base64
        return {"_FillValue": float(np.frombuffer(base64.b64decode(fill), "<f8")[0])}
    in_version_2 = array.fill_value is not None and "_ARRAY_DIMENSIONS" in attributes
    if fill is None and in_version_2 and array.dtype.kind in "iuf":
        return {"_FillValue": array.fill_value.item()}
    return {}


FORMATS = (VolumeFormat("Zarr (.zarr, .zarr.zip)", open_zip, recognises_zip, (".zip", ".ozx")),)
FOLDER_FORMAT = FolderFormat("Zarr", open_folder, recognises_folder)
