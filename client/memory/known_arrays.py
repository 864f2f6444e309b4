"""What each library's arrays and images tell of their place in space.

A library is recognised by the module of the object's type, so that none is imported that the script has not imported.
Physical axes of a patient are left, posterior, superior throughout.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np

from volsplat.client.memory.array_source import HOW_TO_SAY_MORE, UNPLACED, ArraySource
from volsplat.client.memory.given_words import is_of_pint, unit_name
from volsplat.client.memory.library_errors import library_errors
from volsplat.client.memory.no_data import NetcdfValues, with_nan
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.length_units import CommonUnit, in_one_unit, told_several

PATIENT_UNIT = "mm"  # of ITK's images, and of NIfTI's where the header says none
RAS_TO_LPS = np.diag([-1.0, -1.0, 1.0])
NO_SIDES = "the image states neither sform nor qform: left and right cannot be told"
UNEVEN = 1e-3  # of a step: coordinates further from their even places are worth a warning


def source_of(array: Any) -> ArraySource | None:
    """What an object in memory tells, None if it is no array at all. Raises BadInput if it is one that cannot be drawn.

    Also of types that are derived from a library's own.
    """
    with library_errors(f"the {type(array).__name__}"):
        return _told_by(array)


def _told_by(array: Any) -> ArraySource | None:
    if isinstance(array, list | tuple) and array and "pydicom" in _libraries(array[0]):
        return _pydicom(array[0])
    for library in _libraries(array):
        for had, told in _BY_MODULE.get(library, ()):
            if hasattr(array, had):
                return told(array)
    if hasattr(array, "shape") and hasattr(array, "dtype") and hasattr(array, "__getitem__"):
        return ArraySource(array)  # numpy's, zarr's, h5py's
    return ArraySource(np.asarray(array)) if hasattr(array, "__array__") else None


def _libraries(array: Any) -> list[str]:
    """By the types that its type is derived from."""
    return [one.__module__.partition(".")[0] for one in type(array).__mro__]


def _torch(tensor: Any) -> ArraySource:
    values = tensor.detach().cpu().resolve_conj().resolve_neg()
    return ArraySource((values.float() if str(values.dtype) == "torch.bfloat16" else values).numpy())


def _masked(array: Any) -> ArraySource:
    """Numpy's masked arrays, and astropy's."""
    return ArraySource(array.astype(with_nan(array.dtype)).filled(np.nan))


def _quantity(array: Any) -> ArraySource:
    """Astropy's."""
    if hasattr(array, "uncertainty"):  # NDData, of which CCDData is one
        of = ArraySource(array.data) if array.mask is None else _masked(np.ma.masked_array(array.data, array.mask))
        return replace(of, value_unit=str(array.unit or ""))
    values = _masked(array).values if hasattr(array, "mask") else array
    return ArraySource(values.value, value_unit="" if array.unit is None else str(array.unit))


def _pint(quantity: Any) -> ArraySource | None:
    told = _told_by(quantity.magnitude)
    return told and replace(told, value_unit=unit_name(quantity))


def _hdus(parts: Any) -> ArraySource:
    raise BadInput(
        f"the {type(parts).__name__} of a FITS file may have several volumes; give the file's path, which tells where "
        "they lie, or the numbers of one alone, as hdus[0].data"
    )


def _pydicom(dataset: Any) -> ArraySource:
    raise BadInput(
        f"a {type(dataset).__name__} of pydicom is a file of a series; give the series' folder, which tells where its "
        "slices lie, or numbers alone, as dataset.pixel_array"
    )


def _dask(array: Any) -> ArraySource:
    if not isinstance(array._meta, np.ma.MaskedArray):
        return ArraySource(array)
    kept = with_nan(array.dtype)
    return ArraySource(array.astype(kept).map_blocks(np.ma.filled, np.nan, dtype=kept, meta=np.empty(0, kept)))


def _netcdf(variable: Any) -> ArraySource:
    """The last dimension is x."""
    _check_axes(variable.ndim, "choose the others' places, as in variable[0]")
    beside = variable.group().variables
    coordinates = {name: (beside[name][:], _unit(beside[name])) for name in variable.dimensions if name in beside}
    return _by_coordinates(
        NetcdfValues(variable), variable.dimensions, coordinates, str(variable.name), _unit(variable)
    )


def _unit(variable: Any) -> str:
    return str(getattr(variable, "units", ""))


def _xarray(array: Any) -> ArraySource:
    """Of axes with the names x, y and z each is itself; otherwise the last is x."""
    if not hasattr(array, "ndim"):
        raise BadInput(
            f"a {type(array).__name__} has variables, of which each may be a volume; choose one, as data['NAME']"
        )
    _check_axes(array.ndim, "choose the others' places, as in array.isel(time=0)")
    named = {str(name).lower(): name for name in array.dims}
    order = [named[axis] for axis in "zyx"] if set(named) == set("xyz") else list(array.dims)
    coordinates = {name: _xarray_values(array.coords[name]) for name in order if name in array.coords}
    values, unit = _xarray_values(array.transpose(*order))
    name = "" if array.name == getattr(values, "name", None) else array.name  # of a dask array it is a key of dask's
    return _by_coordinates(values, order, coordinates, str(name or "array"), unit)


def _xarray_values(array: Any) -> tuple[Any, str]:
    """And their unit, which stands beside them, or which pint's quantities bring."""
    values = array.data  # read with each look
    if is_of_pint(values):
        return values.magnitude, unit_name(values)
    return values, str(array.attrs.get("units", ""))


def _by_coordinates(
    values: Any, order: Sequence[Any], coordinates: Mapping[Any, tuple[Any, str]], name: str, value_unit: str
) -> ArraySource:
    """Values along these axes, of which some have coordinates, each with its unit."""
    told = [axis for axis in reversed(order) if axis in coordinates]
    rows = {axis: _row(axis, coordinates[axis][0]) for axis in told}
    warnings = [row.warning for row in rows.values() if row.warning]
    units = [coordinates[axis][1] for axis in told]
    common = in_one_unit(units) if units else CommonUnit.none()
    if common is None:
        warnings.append(told_several([unit or "none" for unit in units]))
        common = CommonUnit.none()
    factors = dict(zip(told, common.factors, strict=False))  # where the unit is none there are three
    along = [(rows.get(axis, _Row()), factors.get(axis, 1.0)) for axis in reversed(order)]
    source = ArraySource(
        values,
        name=name,
        matrix=_matrix(np.diag([row.step * factor for row, factor in along])),
        origin=_vector([row.first * factor for row, factor in along]),
        unit=common.unit,
        value_unit=value_unit,
        ordered=bool(coordinates) or set(order) == set("zyx"),
        placed=len(told) == len(order),
        warnings=tuple(warnings),
    )
    if not told or source.placed:
        return source
    others = ", ".join(str(axis) for axis in order if axis not in coordinates)
    apart = f"1 {common.unit}".strip()
    stands = f"{UNPLACED} along {others}: its voxels are drawn {apart} apart there, and it may be mirrored"
    return replace(source, unplaced=f"{stands}; {HOW_TO_SAY_MORE}")


def _simple_itk(image: Any) -> ArraySource:
    import SimpleITK

    _check_image(image.GetDimension(), image.GetNumberOfComponentsPerPixel())
    if image.GetPixelIDTypeAsString().startswith("label"):  # of which SimpleITK makes no array, and crashes
        raise BadInput("a label map has no voxels; make an image of it, as by sitk.Cast(image, sitk.sitkUInt8)")
    directions = np.array(image.GetDirection()).reshape(3, 3)
    values = SimpleITK.GetArrayViewFromImage(image)
    return _itk_source(values, directions * np.array(image.GetSpacing()), image.GetOrigin())


def _itk(image: Any) -> ArraySource:
    import itk

    _check_image(image.GetImageDimension(), image.GetNumberOfComponentsPerPixel())
    directions = itk.array_from_matrix(image.GetDirection())
    return _itk_source(itk.array_view_from_image(image), directions * np.array(image.GetSpacing()), image.GetOrigin())


def _itk_source(values: Any, matrix: Any, origin: Any) -> ArraySource:
    return ArraySource(
        values,
        name="image",
        matrix=_matrix(matrix),
        origin=_vector(origin),
        unit=PATIENT_UNIT,
        ordered=True,
        anatomical=True,
        placed=True,
    )


def _nibabel(image: Any) -> ArraySource:
    _check_axes(len(image.shape), "choose one volume, as in image.slicer[..., 0]")
    units = getattr(image.header, "get_xyzt_units", lambda: ("", ""))()[0]
    path = image.get_filename()
    source = ArraySource(
        np.asarray(image.dataobj).T,
        name=PurePath(path).name if path else "image",
        matrix=_matrix(np.diag(image.header.get_zooms()[:3])),
        unit={"meter": "m", "micron": "um"}.get(units, PATIENT_UNIT),
        ordered=True,
    )
    if image.affine is None:
        return source
    if _states_no_sides(image):
        return replace(source, placed=True, warnings=(NO_SIDES,))
    to_physical = RAS_TO_LPS @ np.asarray(image.affine, float)[:3]
    return replace(
        source, matrix=_matrix(to_physical[:, :3]), origin=_vector(to_physical[:, 3]), anatomical=True, placed=True
    )


def _states_no_sides(image: Any) -> bool:
    """Whether the affine of a NIfTI image is nibabel's own guess."""
    import nibabel

    is_nifti = isinstance(image, nibabel.Nifti1Pair)
    return is_nifti and not any(int(image.header[code]) for code in ("sform_code", "qform_code"))


def _vtk(image: Any) -> ArraySource:
    """Of points, else of cells; pyvista's images are VTK's."""
    if not hasattr(image, "GetDirectionMatrix"):
        raise BadInput(f"a {type(image).__name__} is no image of voxels; resample it to one, as by vtkResampleToImage")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    dims, scalars, shift = np.array(image.GetDimensions()), image.GetPointData().GetScalars(), 0.0
    if scalars is None:
        scalars, dims, shift = image.GetCellData().GetScalars(), np.maximum(dims - 1, 1), 0.5
    if scalars is None:
        raise BadInput("the VTK image has no active scalars; choose them, as by SetActiveScalars")
    _check_image(3, scalars.GetNumberOfComponents())
    direction = np.array([[image.GetDirectionMatrix().GetElement(r, c) for c in range(3)] for r in range(3)])
    matrix = direction * np.array(image.GetSpacing())
    first = np.array(image.GetExtent()[::2], float) + shift
    return ArraySource(
        vtk_to_numpy(scalars).reshape(dims[::-1]),
        name=scalars.GetName() or "image",
        matrix=_matrix(matrix),
        origin=_vector(np.array(image.GetOrigin()) + matrix @ first),
        ordered=True,
        placed=True,
    )


def _check_axes(count: int, cure: str) -> None:
    if count != 3:
        raise BadInput(f"the array has {count} axes, a volume has 3; {cure}")


def _check_image(axes: int, components: int) -> None:
    _check_axes(axes, "join slices to a volume, or take one of several")
    if components != 1:
        raise BadInput(f"the image has {components} numbers a voxel, volsplat needs one; take one of them")


class _Row(NamedTuple):
    """Where the voxels of an axis lie."""

    first: float = 0.0
    step: float = 1.0
    warning: str = ""


def _row(axis: Any, coordinates: Any) -> _Row:
    """By the axis's coordinates. Raises BadInput where no voxel can lie at these."""
    places = np.asarray(coordinates)
    if len(places) == 0:
        return _Row()
    if places.dtype.kind not in "iuf":
        apart = f"the coordinate {axis} is not in numbers: its voxels are drawn 1 apart, and evenly"
        return _Row(warning=apart if len(places) > 1 else "")
    numbers = places.astype(float)
    steps = max(len(numbers) - 1, 1)
    step = float(numbers[-1] - numbers[0]) / steps if len(numbers) > 1 else 1.0
    if not np.isfinite(numbers).all() or step == 0.0:
        raise BadInput(
            f"the coordinate {axis} has numbers that are not finite, or that come twice; correct it, or give the "
            "values alone, as array.values, and spacing="
        )
    off = np.abs(numbers - (numbers[0] + step * np.arange(len(numbers)))).max()
    is_even = off <= UNEVEN * abs(step)
    uneven = f"the coordinate {axis} is uneven: its voxels are drawn as if they lay evenly"
    return _Row(float(numbers[0]), step, "" if is_even else uneven)


def _matrix(rows: Any) -> Matrix:
    a, b, c = (_vector(row) for row in rows)
    return (a, b, c)


def _vector(numbers: Any) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return (x, y, z)


_BY_MODULE: dict[str, tuple[tuple[str, Callable[[Any], ArraySource | None]], ...]] = {
    "numpy": (("mask", _masked),),
    "astropy": (("fileinfo", _hdus), ("unit", _quantity)),
    "dask": (("dask", _dask),),
    "netCDF4": (("dimensions", _netcdf),),
    "pint": (("magnitude", _pint),),
    "pydicom": (("file_meta", _pydicom), ("is_implicit_VR", _pydicom)),
    "torch": (("detach", _torch),),
    "xarray": (("coords", _xarray),),
    "SimpleITK": (("GetDirection", _simple_itk),),
    "itk": (("GetDirection", _itk),),
    "nibabel": (("dataobj", _nibabel),),
    "vtkmodules": (("GetPointData", _vtk),),
}
"""By the top of a type's module: what such an object has, beside others of its library, and what it tells."""
