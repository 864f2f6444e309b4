"""Variables of classic NetCDF files (.nc, .cdf; NetCDF-3 and CDF-5): by name, placed by their coordinates.

`run.nc#density,time=3`. NetCDF-4 is HDF5, and read as that.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.array_file import ArrayFile, cause
from volsplat.mapshade_server.readers.arrays.array_grid import array_grid
from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart, array_part
from volsplat.mapshade_server.readers.arrays.array_values import cf_values, text_attribute
from volsplat.mapshade_server.readers.arrays.array_volume import array_told, array_volume, choose_one, is_minc, shown
from volsplat.mapshade_server.readers.arrays.cf_coordinates import Coordinates, coordinates_of, warnings_of
from volsplat.mapshade_server.readers.arrays.hdf5_dataset import NETCDF_FILL
from volsplat.mapshade_server.readers.arrays.netcdf_header import MAGIC, VERSIONS, Variable, netcdf_variables
from volsplat.mapshade_server.readers.reading.part_options import listed
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat
from volsplat.protocol.text.errors import BadInput

MINC = "rootvariable"  # a variable that only MINC's files have


def recognises(head: bytes) -> bool:
    return head[:3] == MAGIC and len(head) > 3 and head[3] in VERSIONS


def open_netcdf_classic(path: Path, part: str) -> OpenedVolume:
    """The reader for a variable. Raises BadInput if none is a volume, or one must be named, or it is truncated."""
    variables = netcdf_variables(path)
    chosen = array_part(path, part, lambda name: name.strip("/") in variables)
    if MINC in variables:
        raise is_minc(chosen)
    variable = _chosen(chosen, variables)
    chosen = chosen._replace(path=variable.name)
    _check_there(chosen, variable)
    never_written = {"missing_value": NETCDF_FILL} if variable.dtype.kind == "f" else {}
    values = cf_values(chosen.whole, variable.dtype, {**never_written, **variable.attributes})
    axes = zip(variable.dimensions, variable.shape, strict=True)
    coordinates = [_coordinates(chosen, length, name, variables.get(name)) for name, length in axes]
    grid = array_grid(chosen, [one.axis for one in coordinates])
    return array_volume(
        chosen,
        f"NetCDF-3 variable {variable.name}",
        grid,
        values,
        lambda selection: _picked(chosen, variable, selection),
        density_name=text_attribute(variable.attributes, "long_name") or variable.name,
        value_unit=text_attribute(variable.attributes, "units"),
        warnings=warnings_of(coordinates, grid),
        parts=(),
    )


def _chosen(part: ArrayPart, variables: dict[str, Variable]) -> Variable:
    """The variable that the part names, else the only one with enough axes."""
    name = part.path.strip("/")
    every = listed(shown([array_told(one.name, one.shape) for one in variables.values()]))
    if name:
        if name not in variables:
            raise BadInput(f"{part.place}: has no variable “{name}”; it holds {every}")
        return variables[name]
    volumes = {one.name: one for one in variables.values() if len(one.shape) >= 3 and one.dtype.kind != "S"}
    if not volumes:
        raise BadInput(f"{part.place}: holds no variable with three axes of numbers; it holds {every}")
    if len(volumes) > 1:
        raise choose_one(part, part.place, [array_told(one.name, one.shape) for one in volumes.values()])
    return next(iter(volumes.values()))


def _check_there(part: ArrayPart, variable: Variable) -> None:
    """Raises BadInput if the file ends before the variable does."""
    there = Path(part.place).stat().st_size
    if variable.end > there:
        raise BadInput(
            f"{part.whole}: is truncated, its numbers end at byte {variable.end} and the file at {there}; "
            "fetch or export it again"
        )


def _coordinates(part: ArrayPart, length: int, name: str, variable: Variable | None) -> Coordinates:
    """The axis `name`, by the variable of that name if it has it alone."""
    if variable is None or variable.dimensions != (name,) or variable.dtype.kind == "S":
        return coordinates_of(length, name, None, {})
    _check_there(part._replace(path=name), variable)
    return coordinates_of(length, name, lambda: _picked(part, variable, (slice(0, length),)), variable.attributes)


def _picked(part: ArrayPart, variable: Variable, selection: tuple[int | slice, ...]) -> NDArray[Any]:
    """What indexing the variable gives. Raises BadInput if the file has become shorter."""
    path = Path(part.place)
    try:
        if not variable.record_bytes:
            return ArrayFile(path, variable.begin, variable.dtype, variable.shape, "C").pick(selection)
        records, *others = selection
        if isinstance(records, int):
            return _record(path, variable, records, tuple(others))
        wanted = range(records.start, records.stop)
        return np.stack([_record(path, variable, number, tuple(others)) for number in wanted])
    except (OSError, EOFError) as error:
        raise BadInput(f"{part.whole}: {cause(error)}; fetch or export it again") from None


def _record(path: Path, variable: Variable, number: int, selection: tuple[int | slice, ...]) -> NDArray[Any]:
    begin = variable.begin + number * variable.record_bytes
    if not selection:
        return ArrayFile(path, begin, variable.dtype, (1,), "C").pick((0,))
    return ArrayFile(path, begin, variable.dtype, variable.shape[1:], "C").pick(selection)


FORMATS = (VolumeFormat("NetCDF-3 (.nc)", open_netcdf_classic, recognises),)
