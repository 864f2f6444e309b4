"""Arrays and images of every library that is known: where they lie in space, and that servers draw what they hold."""

from __future__ import annotations

import copy
import gc
import multiprocessing
import os
import pickle
import sys
import warnings
import weakref
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import dask.array
import h5py
import netCDF4
import nibabel
import numpy as np
import pydicom
import pytest
import pyvista
import SimpleITK
import torch
import xarray
import zarr
from astropy import units
from astropy.io import fits
from astropy.nddata import CCDData
from astropy.table import Column, MaskedColumn
from astropy.utils.masked import Masked

from support.files.refusals import assert_refused_in_one_line
from volsplat.client import Session
from volsplat.client.memory import shared_memory
from volsplat.client.memory.array_volume import OrientationUnknown, Volume
from volsplat.client.memory.known_arrays import source_of
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput

VALUES = np.random.default_rng(1).integers(0, 3000, (6, 7, 8)).astype(np.int16)  # [z, y, x]
STEPS, ORIGIN = (0.5, 0.75, 2.0), (10.0, -20.0, 30.0)
UNKNOWN = pytest.mark.filterwarnings("ignore::volsplat.client.memory.array_volume.OrientationUnknown")


def labelled() -> Any:
    coords = {
        axis: (axis, first + step * np.arange(length), {"units": "um"})
        for axis, first, step, length in zip("xyz", ORIGIN, STEPS, VALUES.shape[::-1], strict=True)
    }
    return xarray.DataArray(VALUES, coords, ("z", "y", "x"), name="cells", attrs={"units": "counts"}).transpose(
        "y", ...
    )


def itk_image() -> Any:
    image = SimpleITK.GetImageFromArray(VALUES)
    image.SetSpacing(STEPS)
    image.SetOrigin(ORIGIN)
    image.SetDirection((0, 1, 0, -1, 0, 0, 0, 0, 1))
    return image


def nifti() -> Any:
    affine = np.diag([-STEPS[0], STEPS[1], STEPS[2], 1.0])  # LAS: mirrored on the way to RAS
    affine[:3, 3] = ORIGIN
    return nibabel.Nifti1Image(VALUES.T, affine)


def vtk_image(of_cells: bool = False) -> Any:
    image = pyvista.ImageData(dimensions=[n + of_cells for n in VALUES.shape[::-1]], spacing=STEPS, origin=ORIGIN)
    (image.cell_data if of_cells else image.point_data)["density"] = VALUES.ravel()
    return image


BARE: dict[str, Callable[[Path], Any]] = {
    "numpy": lambda folder: VALUES,
    "numpy in Fortran's order": lambda folder: np.asfortranarray(VALUES),
    "big-endian": lambda folder: VALUES.astype(">i2"),
    "torch": lambda folder: torch.from_numpy(VALUES),
    "dask": lambda folder: dask.array.from_array(VALUES, chunks=(4, 3, 8)),
    "zarr": lambda folder: zarr.create_array(store=folder / "v.zarr", data=VALUES, chunks=(4, 3, 8)),
    "h5py": lambda folder: h5py.File(folder / "v.h5", "w").create_dataset("v", data=VALUES),
}
PLACED: dict[str, tuple[Callable[[], Any], tuple[tuple[float, ...], ...], tuple[float, ...], str, bool]] = {
    "xarray": (labelled, ((0.5, 0, 0), (0, 0.75, 0), (0, 0, 2)), ORIGIN, "µm", False),
    "SimpleITK": (itk_image, ((0, 0.75, 0), (-0.5, 0, 0), (0, 0, 2)), ORIGIN, "mm", True),
    "nibabel": (nifti, ((0.5, 0, 0), (0, -0.75, 0), (0, 0, 2)), (-10.0, 20.0, 30.0), "mm", True),
    "pyvista": (vtk_image, ((0.5, 0, 0), (0, 0.75, 0), (0, 0, 2)), ORIGIN, "", False),
    "cells of VTK": (
        lambda: vtk_image(True),
        ((0.5, 0, 0), (0, 0.75, 0), (0, 0, 2)),
        (10.25, -19.625, 31.0),
        "",
        False,
    ),
}


class OnGraphicsCard:
    """As CuPy's arrays, which copy nothing unless they are told to."""

    shape, dtype = VALUES.shape, VALUES.dtype

    def __getitem__(self, part: object) -> OnGraphicsCard:
        return self

    def __array__(self, *asked: object, **options: object) -> None:
        raise TypeError("fetch it by .get()")


HIDDEN = np.ma.masked_greater(VALUES, 2000)


def packed_variable(folder: Path) -> Any:
    """With halves, kept as whole numbers, and coordinates along two of its axes."""
    file = netCDF4.Dataset(folder / "v.nc", "w")
    for axis, length in zip("zyx", VALUES.shape, strict=True):
        file.createDimension(axis, length)
    for axis, step in (("y", 0.5), ("x", 2.0)):
        coordinate = file.createVariable(axis, "f4", (axis,))
        coordinate[:], coordinate.units = step * np.arange(file.dimensions[axis].size), "km"
    variable = file.createVariable("kept", "i2", ("z", "y", "x"), fill_value=-1)
    variable.scale_factor, variable.units = 0.5, "K"
    variable[:] = HIDDEN / 2
    return variable


MASKED: dict[str, tuple[Callable[[Path], Any], float, str]] = {
    "numpy": (lambda folder: HIDDEN, 1.0, ""),
    "dask": (lambda folder: dask.array.from_array(HIDDEN, chunks=(4, 3, 8)), 1.0, ""),
    "astropy": (lambda folder: Masked(HIDDEN.data * units.K, mask=HIDDEN.mask), 1.0, "K"),
    "netCDF4": (packed_variable, 0.5, "K"),
}


def read(volume: Volume) -> Any:
    reader = open_volume(volume.place)
    return reader.read(reader.description.geometry.box)


@UNKNOWN
@pytest.mark.parametrize("library", BARE)
def test_servers_read_the_numbers_of_a_bare_array(library: str, tmp_path: Path) -> None:
    volume = Volume(BARE[library](tmp_path))
    assert np.array_equal(read(volume), VALUES)
    assert open_volume(volume.place).description.scalar_type == "int16"
    assert any("does not say how it lies" in warning for warning in volume.description.warnings)


@UNKNOWN
@pytest.mark.parametrize("library", MASKED)
@pytest.mark.parametrize("axes", [None, "xyz"])
def test_what_is_masked_is_no_data(library: str, axes: str | None, tmp_path: Path) -> None:
    make, scale, unit = MASKED[library]
    axes = None if library == "netCDF4" else axes  # which it knows
    volume = Volume(make(tmp_path), axes=axes)
    expected = np.ma.filled(HIDDEN.astype(np.float32), np.nan) * scale
    assert np.array_equal(read(volume), expected if axes is None else expected.T, equal_nan=True)
    assert volume.description.value_unit == unit


@UNKNOWN
def test_a_netcdf_variable_lies_where_its_coordinates_say(tmp_path: Path) -> None:
    told = Volume(packed_variable(tmp_path)).description
    assert told.name == "kept" and told.geometry.index_to_physical == ((2.0, 0, 0), (0, 0.5, 0), (0, 0, 1.0))
    assert any("does not say how it lies" in warning for warning in told.warnings)  # nothing is known of z


def test_astropys_quantities_have_their_unit() -> None:
    assert Volume(VALUES * units.Jy / units.beam, spacing=(1, 1, 1)).description.value_unit == "Jy / beam"
    measured = Volume(CCDData(VALUES, unit="adu", mask=VALUES < 1500), spacing=(1, 1, 1))
    assert measured.description.value_unit == "adu"
    assert np.array_equal(read(measured), np.where(VALUES < 1500, np.nan, VALUES), equal_nan=True)
    assert Volume(CCDData(VALUES, unit="adu"), spacing=(1, 1, 1)).description.scalar_type == "int16"


def with_coordinates(x: str, y: str, z: str) -> Any:
    """Steps of one in these units along each axis; one sheet of z."""
    coords = {axis: (axis, np.arange(5.0, 7.0), {"units": unit}) for axis, unit in zip("xy", (x, y), strict=True)}
    return xarray.DataArray(np.ones((1, 2, 2)), coords | {"z": ("z", [50.0], {"units": z})}, ("z", "y", "x"))


def at_places(x: Any) -> Any:
    coords = {"x": x, "y": [0.0, 1.0], "z": [0.0, 1.0]}
    return xarray.DataArray(np.ones((2, 2, len(x))), coords, ("z", "y", "x"))


def shrunken() -> Any:
    return dask.array.from_array(VALUES, chunks=VALUES.shape).map_blocks(lambda block: block[..., ::2], dtype="i2")


PLACE: dict[str, Any] = {"spacing": (1, 1, 1)}


@pytest.mark.parametrize(
    "places", [np.arange("2020-01", "2020-04", dtype="datetime64[D]")[:3], ["red", "green", "blue"], [0.0, 1.0, 5.0]]
)
def test_of_coordinates_is_told_what_is_true(places: Any) -> None:
    told = Volume(at_places(places)).description
    (warning,) = told.warnings
    assert ("uneven" in warning) == isinstance(places[0], float)
    assert ("the coordinate x is not in numbers: its voxels are drawn 1 apart" in warning) == ("uneven" not in warning)


def test_axes_without_coordinates_are_told_and_the_others_are_brought_to_one_unit() -> None:
    array = with_coordinates("km", "m", "").drop_vars("z")
    with pytest.warns(OrientationUnknown, match="along z: its voxels are drawn 1 km apart there, and it may be mirr"):
        told = Volume(array).description
    assert np.allclose(np.diag(told.geometry.index_to_physical), (1.0, 0.001, 1.0)) and told.unit == "km"
    assert Volume(array, spacing=(1, 2, 3)).description.warnings == ()


@pytest.mark.parametrize("unit", ["", "mm", units.mm, "um", "µm"])
def test_lengths_that_bring_their_unit_are_as_long_in_every_other(unit: Any) -> None:
    lengths: dict[str, Any] = {"spacing": [1, 2, 0.5] * units.cm, "origin": (1 * units.m, 2 * units.cm, 3 * units.mm)}
    told = Volume(VALUES, **lengths, unit=unit).description
    assert told.unit == str(unit or "cm")
    one = (1 * units.cm).to_value(unit or "cm")
    assert np.allclose(np.diag(told.geometry.index_to_physical), np.multiply((1, 2, 0.5), one))
    assert np.allclose(told.geometry.origin, np.multiply((100, 2, 0.3), one))


class PintQuantity:
    """Quacks as pint's does, which nothing here needs."""

    __module__ = "pint.registry"
    _METRES: ClassVar = {"m": 1.0, "mm": 1e-3, "um": 1e-6}

    def __init__(self, magnitude: Any, unit: str) -> None:
        self.magnitude, self.units = magnitude, PintUnit(unit)

    def to(self, unit: str) -> PintQuantity:
        if unit not in self._METRES:
            raise AttributeError(f"{unit!r} is not defined in the unit registry")
        return PintQuantity(np.multiply(self.magnitude, self._METRES[self.units.name] / self._METRES[unit]), unit)


class PintUnit:
    dimensionality = "[length]"

    def __init__(self, name: str) -> None:
        self.name = name

    def __format__(self, how: str) -> str:
        assert how == "~", "else it is written in full"
        return self.name


@pytest.mark.parametrize("unit", ["", "mm", PintUnit("mm")])
def test_pints_lengths_and_values_bring_their_unit(unit: Any) -> None:
    for spacing in (PintQuantity([1, 2, 500], "um"), tuple(PintQuantity(one, "um") for one in (1, 2, 500))):
        told = Volume(PintQuantity(VALUES, "K"), spacing=spacing, unit=unit).description
        assert (told.unit, told.value_unit, told.scalar_type) == ("mm" if unit else "um", "K", "int16")
        assert np.allclose(told.geometry.spacing, np.multiply((1, 2, 500), 1e-3 if unit else 1))
    with pytest.raises(BadInput, match="cannot be brought to “s”: 's' is not defined"):
        Volume(VALUES, spacing=spacing, unit="s")


def test_what_pint_itself_makes_is_taken_so() -> None:
    pint = pytest.importorskip("pint")
    unit = pint.UnitRegistry()
    told = Volume(VALUES * unit.kelvin, spacing=np.array([1, 2, 3]) * unit.um, unit="mm").description
    assert told.value_unit == "K" and np.allclose(told.geometry.spacing, (0.001, 0.002, 0.003))
    with pytest.raises(BadInput, match="cannot be brought to “s”: Cannot convert"):
        Volume(VALUES, spacing=np.array([1, 2, 3]) * unit.um, unit="s")


def test_a_library_that_says_nothing_of_a_name_or_a_unit_gives_none() -> None:
    of_dask = xarray.DataArray(dask.array.from_array(VALUES), dims=("z", "y", "x"))
    assert Volume(of_dask, spacing=(1, 1, 1)).description.name == "array"
    assert Volume(of_dask.rename("cells"), spacing=(1, 1, 1)).description.name == "cells"
    columns = Column(VALUES), Column(VALUES, unit="K"), MaskedColumn(VALUES)
    assert [Volume(column, spacing=(1, 1, 1)).description.value_unit for column in columns] == ["", "K", ""]


@pytest.mark.parametrize("several", [False, True])
def test_what_a_session_cannot_draw_of_dicom_and_fits_names_the_cure(several: bool) -> None:
    dataset = pydicom.Dataset()
    for volume, cure in (
        ([dataset, dataset] if several else dataset, "give the series' folder, .* or numbers alone, as dataset.pixel"),
        (fits.HDUList([fits.PrimaryHDU(VALUES)]) if several else fits.PrimaryHDU(VALUES), "numbers of one alone, as"),
    ):
        with pytest.raises(BadInput, match=cure):
            Session(volume)


def test_lengths_are_brought_to_the_unit_that_an_image_has() -> None:
    told = Volume(itk_image(), spacing=[1, 1, 1] * units.cm).description
    assert told.unit == "mm" and np.allclose(told.geometry.spacing, 10)
    assert np.allclose(told.geometry.origin, ORIGIN)


def test_values_that_torch_holds_negated_are_drawn_as_they_are() -> None:
    held = torch.complex(torch.zeros(VALUES.shape), torch.from_numpy(VALUES).float()).conj().imag
    assert held.is_neg() and np.array_equal(read(Volume(held, **PLACE)), -VALUES)


@pytest.mark.parametrize("ending", [".nii", ".nii.gz"])
@pytest.mark.parametrize("left", [0.0, 0.7])
def test_a_file_that_is_cut_short_or_gone_is_told_in_a_line(ending: str, left: float, tmp_path: Path) -> None:
    path = tmp_path / f"v{ending}"
    nibabel.save(nifti(), path)
    image, whole = nibabel.load(path), path.read_bytes()
    path.write_bytes(whole[: int(left * len(whole))]) if left else path.unlink()
    with pytest.raises(BadInput, match="the Nifti1Image cannot be read: .+") as raised:
        Volume(image)
    assert "\n" not in str(raised.value)


def test_an_array_of_a_closed_file_is_told_in_a_line(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "v.h5", "w") as file:
        array = file.create_dataset("v", data=VALUES)
    with pytest.raises(BadInput, match="cannot be read: "):
        Volume(array, **PLACE)


def test_coordinates_in_several_units_of_length_are_brought_to_one() -> None:
    geometry = (told := Volume(with_coordinates("km", "m", "m")).description).geometry
    assert (told.unit, told.warnings) == ("km", ())
    assert np.allclose(np.diag(geometry.index_to_physical), (1.0, 0.001, 0.001))
    assert np.allclose(geometry.origin, (5.0, 0.005, 0.05)), "one sheet has a place as well"
    (warning,) = Volume(with_coordinates("m", "m", "Pa")).description.warnings
    assert "several units (m, m, Pa), drawn as if these were one" in warning


def test_sides_that_a_nifti_image_does_not_state_are_not_made_up() -> None:
    image = nifti()
    image.header.set_sform(None, 0)
    image.header.set_qform(None, 0)
    told = Volume(image).description
    assert not told.anatomical and "left and right cannot be told" in "".join(told.warnings)
    assert np.allclose(told.geometry.index_to_physical, np.diag(STEPS))
    with pytest.warns(OrientationUnknown):
        assert not Volume(nibabel.Nifti1Image(VALUES.T, None)).description.anatomical


def test_chunks_of_sheets_are_computed_once_though_they_exceed_what_is_copied_at_a_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(shared_memory, "BYTES_AT_ONCE", 2 * VALUES[0].nbytes)
    computed: list[int] = []

    def compute(block: Any) -> Any:
        computed.append(len(block))
        return block

    chunks = dask.array.from_array(VALUES, chunks=(3, 7, 8)).map_blocks(compute, dtype=VALUES.dtype, meta=VALUES[:0])
    assert np.array_equal(read(Volume(chunks, spacing=(1, 1, 1))), VALUES)
    assert computed == [3, 3]


class Moody:
    """A block of dask, or a source of its own, that raises whatever its author thought of."""

    shape, dtype = VALUES.shape, VALUES.dtype

    def __init__(self, error: Exception) -> None:
        self._error = error

    def __getitem__(self, index: Any) -> Any:
        raise self._error


class Unreadable:
    """As an array of a file whose numbers are packed in a way that nothing here unpacks."""

    shape, dtype = VALUES.shape, VALUES.dtype

    def __getitem__(self, index: Any) -> Any:
        raise OSError("can't open directory (/usr/local/hdf5/lib/plugin)")


@pytest.mark.parametrize("library", PLACED)
def test_an_image_lies_where_its_library_says(library: str) -> None:
    make, matrix, origin, unit, anatomical = PLACED[library]
    volume = Volume(make())
    told = open_volume(volume.place).description
    assert np.allclose(told.geometry.index_to_physical, matrix) and np.allclose(told.geometry.origin, origin)
    assert (told.unit, told.anatomical, told.warnings) == (unit, anatomical, ())
    assert np.array_equal(read(volume), VALUES)


def test_what_the_caller_says_of_an_array_counts() -> None:
    affine = np.diag([-1.0, 1.0, 2.0, 1.0])
    by_affine = Volume(VALUES.T, axes="xyz", affine=affine, space="RAS", kind="ct", unit="mm").description
    by_space = Volume(VALUES, spacing=(1, 1, 2), space="LAS", kind="CT", unit="mm").description
    by_codes = Volume(VALUES, axes=tuple("zyx"), spacing=(1, 1, 2), space=tuple("LAS"), kind="CT", unit="mm")
    assert by_affine == by_space == by_codes.description and by_space.anatomical
    assert by_space.geometry.index_to_physical == ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 2.0))
    assert Volume(nifti(), spacing=(1, 1, 1)).description.geometry.index_to_physical[1] == (0.0, -1.0, 0.0)


@pytest.mark.parametrize(
    ("array", "options", "message"),
    [
        (VALUES[0], {}, "of shape (7, 8) is no volume, which has three axes; put slices together, as np.stack(slices)"),
        (VALUES[None, None], {}, "no volume, which has three axes; choose a part, as array[0, 0]"),
        (VALUES[..., None].repeat(3, -1), {}, "no volume, which has three axes; choose a part, as array[..., 0]"),
        (VALUES[:0], {}, "of shape (0, 7, 8) has no voxels"),
        (VALUES.astype(complex), {}, "an array of complex128 is no volume"),
        (VALUES, {"kind": "CT"}, "kind=CT: is of a patient, whose sides the array does not tell; give spacing="),
        (VALUES, {"kind": "MR", "spacing": (1, 1, 1)}, "kind=MR: is of a patient"),
        (itk_image(), {"space": "RAS"}, "the image says itself which sides"),
        *(
            (image, {"axes": "xyz"}, " says itself which of its axes are x, y and z; leave axes= out")
            for image in (nifti(), itk_image(), vtk_image(), labelled())
        ),
        (nifti(), {"axes": "zyx"}, "axes='zyx': image says itself which"),
        (VALUES, {"axes": "xxz"}, "name each of x, y and z once"),
        (VALUES, {"space": "LRS"}, "name the sides of the patient"),
        (VALUES, {"spacing": (1, 2)}, "spacing must be 3 finite numbers"),
        (VALUES, {"spacing": (1, 2, 0)}, "the array has no place in space"),
        (VALUES, {"kind": "CAT"}, "is none of"),
        (object(), {}, "a volume is wanted, not a object"),
        (xarray.Dataset({"cells": labelled()}), {}, "a Dataset has variables, of which each may be a volume; choose"),
        (torch.from_numpy(VALUES).to_sparse(), {}, "the Tensor gives no numbers that could be drawn"),
        (torch.empty((2, 2, 2), device="meta"), {}, "the Tensor gives no numbers that could be drawn"),
        (OnGraphicsCard(), {"spacing": (1, 1, 1)}, "gives no numbers that could be drawn: fetch it by .get()"),
        (Unreadable(), {"spacing": (1, 1, 1)}, "the array cannot be read: can't open directory (/usr"),
        (Moody(KeyError("frame")), PLACE, "the array cannot be read: KeyError: 'frame'"),
        (Moody(ValueError("two\nlines")), PLACE, "the array cannot be read: ValueError: two lines"),
        (Moody(EOFError()), PLACE, "the array cannot be read: EOFError"),
        (Moody(MemoryError()), PLACE, "the array does not fit into this machine's memory"),
        (shrunken(), PLACE, "the array gave (6, 7, 4) numbers where it had promised (6, 7, 8); compute it first"),
        (dask.array.from_array(VALUES)[dask.array.from_array(VALUES[:, 0, 0]) > 0], PLACE, "compute_chunk_sizes()"),
        (labelled().isel(z=slice(0)), {}, "has no voxels"),
        (at_places([0.0, 1.0, np.nan]), {}, "the coordinate x has numbers that are not finite, or that come twice;"),
        (at_places([1.0, 1.0, 1.0]), {}, "the coordinate x has numbers that are not finite, or that come twice;"),
        (VALUES, {"axes": 3}, "axes=3: name each of x, y and z once, as 'zyx'"),
        (VALUES, {"space": 3}, "space=3: name the sides of the patient"),
        (VALUES, {"space": (None, "A", "S")}, "name the sides of the patient"),
        (VALUES, {"unit": 3}, "unit must be a text, not 3"),
        (VALUES, {"name": 3}, "name must be a text, not 3"),
        (VALUES, {"spacing": (1 * units.mm, 1, 1)}, "cannot be brought to “mm”: some of them have no unit"),
        (VALUES, {"spacing": [1, 1, 1] * units.K, "unit": "mm"}, "cannot be brought to “mm”: 'K'"),
        (VALUES, {"spacing": [1, 1] * units.mm}, "spacing must be 3 finite numbers, not <Quantity"),
        (np.zeros((6, 7, 8), "i2,f4").view(np.recarray), {}, "is no volume; convert it to numbers such as float32"),
        (SimpleITK.Image([4, 4, 4], SimpleITK.sitkLabelUInt16), {}, "as by sitk.Cast(image, sitk.sitkUInt8)"),
        (pyvista.Sphere(), {}, "a PolyData is no image of voxels; resample it to one"),
    ],
)
@UNKNOWN
def test_what_is_no_volume_is_refused_in_a_line(array: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInput) as raised:
        Volume(array, **options)
    assert message in str(raised.value) and "\n" not in str(raised.value)


def test_a_bare_array_is_drawn_with_a_note() -> None:
    with pytest.warns(OrientationUnknown, match="may be mirrored") as told:
        Volume(VALUES)
        SingleProcess(VALUES).close()
    assert [Path(one.filename) for one in told] == 2 * [Path(__file__)], "each points at the caller's line"
    with warnings.catch_warnings(action="error"):
        Volume(VALUES, spacing=(1, 1, 1))


def test_an_array_that_does_not_fit_into_memory_is_refused_before_any_of_it_is_computed() -> None:
    array = dask.array.zeros((1 << 14, 1 << 14, 1 << 14), chunks=1 << 8, dtype="float32")
    with pytest.raises(BadInput, match=r"takes 16384\.0 GiB once more.*prepare"):
        Volume(array, spacing=(1, 1, 1))


def test_an_array_may_have_a_long_name() -> None:
    name = "\N{CJK UNIFIED IDEOGRAPH-9AA8}" * 90
    assert open_volume(Volume(VALUES, spacing=(1, 1, 1), name=name).place).description.name == name


def test_a_path_is_no_array() -> None:
    assert source_of("head.nrrd") is None and source_of(3) is None


def test_servers_draw_an_array_as_a_single_process_does_and_it_is_given_back() -> None:
    volume = Volume(VALUES, spacing=(1, 1, 1))
    with Session(volume, workers=2, threads=2, memory="1G", listen="127.0.0.1:0") as session:
        scene = session.default_scene().with_(size=48)
        drawn = session.finish(scene).published.pixels
    with SingleProcess(volume) as single:
        assert drawn.max() > 0 and np.array_equal(drawn, single.finish(scene).published.pixels)
    place = volume_name(volume.place).place
    volume.close()
    assert not os.path.exists(place)


def assert_closed(use: Callable[[], object]) -> None:
    with pytest.raises(BadInput, match=r"closed.*; make it anew, as by Volume\(array\)$"):
        use()


def test_what_is_known_of_a_drawn_volume_goes_with_it_before_the_collector_runs() -> None:
    gc.disable()
    try:
        with SingleProcess(Volume(VALUES, spacing=STEPS), threads=1) as single:
            known = weakref.ref(single.volume)
            for window in ("auto", (0.0, 2000.0)):
                scene = single.volume.begun_scene(None, Quantise(window=window))
                single.render(scene.with_(size=20, zoom="fit"))
        del single
        assert known() is None
    finally:
        gc.enable()


def test_volumes_go_to_other_processes_and_back_with_their_voxels() -> None:
    volumes = (Volume(VALUES + n, spacing=(1, 1, 1), name=str(n)) for n in range(4))  # nobody keeps them
    with ProcessPoolExecutor(1, multiprocessing.get_context("forkserver")) as pool:
        answers = [pool.submit(copy.copy, volume) for volume in volumes]
        for n, answer in enumerate(answers):
            assert answer.result().description.name == str(n) and np.array_equal(read(answer.result()), VALUES + n)


def test_a_copy_is_the_volume_itself_for_nobody_can_change_it() -> None:
    volume = Volume(VALUES, spacing=(1, 1, 1))
    assert copy.copy(volume) is volume and copy.deepcopy({"a": volume})["a"] is volume
    pickled = pickle.dumps(volume)
    volume.close()
    assert np.array_equal(read(pickle.loads(pickled)), VALUES)


def test_another_volume_is_never_taken_for_one_that_is_closed() -> None:
    volume = Volume(VALUES, spacing=(1, 1, 1))
    place, pickled = volume.place, pickle.dumps(volume)
    with Session(volume, workers=1) as session, SingleProcess(volume) as single:
        assert session.volume is not None
        volume.close()
        other = Volume(VALUES, spacing=(1, 1, 1))
        assert volume_name(other.place).place == volume_name(place).place, "the number is taken again"
        for opened in (session, single):
            assert_closed(partial(opened.file_voxel, (0, 0, 0)))
    assert_closed(lambda: open_volume(place))
    assert_closed(lambda: pickle.dumps(volume))
    assert_closed(lambda: SingleProcess(volume))
    assert_closed(lambda: Session(volume))
    assert np.array_equal(read(pickle.loads(pickled)), VALUES)


@pytest.mark.parametrize("options", [{"spawn": False}, {"cluster": "lab.toml"}])
def test_a_session_across_machines_names_the_cure(options: dict[str, Any]) -> None:
    with pytest.raises(BadInput, match=r"save it first, as by numpy\.save"):
        Session(Volume(VALUES, spacing=(1, 1, 1)), **options)


def test_a_damaged_array_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "v"
    path.write_bytes(b"volsplat-array-1" + (200).to_bytes(8, "little") + bytes(5000))
    assert_refused_in_one_line(lambda named: open_volume(str(named)), path, "no array that volsplat shares", capfd)


def test_no_library_is_imported_that_the_script_has_not_imported(tmp_path: Path) -> None:
    import subprocess

    code = (
        "import sys, numpy, volsplat as vs; vs.Volume(numpy.ones((2, 2, 2)), spacing=(1, 1, 1))\n"
        "assert not {'torch', 'xarray', 'dask', 'zarr', 'itk', 'nibabel', 'vtkmodules'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
