"""Classic NetCDF as the NetCDF library writes it: every type, records, coordinates, and what is missing or cut off."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole
from support.files.volume_files import DIMS, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

with pytest.MonkeyPatch.context() as kept:
    # It points HDF5, which other tests use in this process, to filters of its own; unfinished on leaving.
    kept.setenv("HDF5_PLUGIN_PATH", os.environ.get("HDF5_PLUGIN_PATH", ""))
    netCDF4 = pytest.importorskip("netCDF4")

FORMATS = {
    "NETCDF3_CLASSIC": ("int8", "int16", "int32", "float32", "float64"),
    "NETCDF3_64BIT_OFFSET": ("int16", "float32"),
    "NETCDF3_64BIT_DATA": ("uint8", "uint16", "uint32", "int64", "uint64", "float64"),
}
CASES = [(version, scalar_type) for version, types in FORMATS.items() for scalar_type in types]


def written(path: Path, fill: Callable[[Any], object], version: str = "NETCDF3_CLASSIC") -> Path:
    """A file with the dimensions z, y, x and time, which counts records."""
    with netCDF4.Dataset(path, "w", format=version) as file:
        for name, size in zip("zyx", DIMS[::-1], strict=True):
            file.createDimension(name, size)
        file.createDimension("time", None)
        file.history = "made by a test"
        file.setncattr("numbers", np.arange(5, dtype=np.int16))
        fill(file)
    return path


def variable(file: Any, name: str, axes: tuple[str, ...], values: Any, **attributes: Any) -> None:
    made = file.createVariable(name, values.dtype, axes, fill_value=attributes.pop("_FillValue", None))
    made.set_auto_maskandscale(False)
    made.setncatts(attributes)
    made[:] = values


def one(path: Path, values: Voxels, **attributes: Any) -> Path:
    return written(path, lambda file: variable(file, "rho", ("z", "y", "x"), values, **attributes))


@pytest.mark.parametrize(("version", "scalar_type"), CASES)
def test_every_type_comes_back_from_every_version(version: str, scalar_type: str, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    path = written(tmp_path / "v.nc", lambda file: variable(file, "rho", ("z", "y", "x"), values), version)
    told = described(path)
    assert told.scalar_type == scalar_type and told.format == "NetCDF-3 variable rho"
    got = read_whole(path)
    assert got.dtype == values.dtype and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values)
    part = open_volume(str(path)).read(Box((1, 2, 0), (5, 4, 3)))
    assert part.flags.c_contiguous
    np.testing.assert_array_equal(part, values[0:3, 2:4, 1:5])


@pytest.mark.parametrize("version", ["NETCDF3_CLASSIC", "NETCDF4"])
def test_an_axis_that_is_not_drawn_is_not_warned_of(version: str, tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        variable(file, "rho", ("time", "z", "y", "x"), np.stack([values_of("int16")] * 3))
        variable(file, "time", ("time",), np.array([0.0, 1.0, 5.0]))

    path = written(tmp_path / "v.nc", fill, version)
    assert described(f"{path}#rho,time=1").warnings == ()
    assert "time is unevenly spaced" in described(f"{path}#rho,x=1").warnings[0]


@pytest.mark.parametrize("version", FORMATS)
@pytest.mark.parametrize("alone", [True, False])
def test_records_lie_among_those_of_other_variables(version: str, alone: bool, tmp_path: Path) -> None:
    """Records of several variables take turns and are padded; those of one alone are not."""
    moments = np.arange(4 * 3 * 6 * 7, dtype=np.int8).reshape(4, 3, 6, 7)[:, :, :, :]
    movie = np.arange(4 * 6 * 7, dtype=np.int8).reshape(4, 6, 7)

    def fill(file: Any) -> None:
        file.createDimension("level", 3)
        if not alone:
            variable(file, "count", ("time",), np.arange(4, dtype=np.int16))
            variable(file, "moments", ("time", "level", "y", "x"), moments)
        variable(file, "movie", ("time", "y", "x"), movie)

    path = written(tmp_path / "v.nc", fill, version)
    np.testing.assert_array_equal(read_whole(f"{path}#movie"), movie)
    np.testing.assert_array_equal(open_volume(f"{path}#movie").read(Box((2, 1, 1), (5, 6, 3))), movie[1:3, 1:6, 2:5])
    if not alone:
        np.testing.assert_array_equal(read_whole(f"{path}#moments,time=2"), moments[2])
        np.testing.assert_array_equal(read_whole(f"{path}#moments,level=1"), moments[:, 1])
        with pytest.raises(BadInput, match="choose an index of time, as in .*#moments,time=0"):
            open_volume(f"{path}#moments")


def test_coordinates_give_the_place(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        variable(file, "rho", ("z", "y", "x"), values_of("float32"), units="kg m-3", long_name="air density")
        variable(file, "z", ("z",), np.arange(5.0) * 10 + 5, units="m", positive="up")
        variable(file, "y", ("y",), 30 - np.arange(6.0) * 2, units="m")
        variable(file, "x", ("x",), np.arange(7, dtype=np.float32) * 3, units="m")

    told = described(written(tmp_path / "v.nc", fill))
    assert told.geometry.index_to_physical == ((3, 0, 0), (0, -2, 0), (0, 0, 10))  # y goes down: not mirrored
    assert told.geometry.origin == (0, 30, 5) and told.unit == "m"
    assert told.up == "+z"
    assert (told.value_unit, told.density_name) == ("kg m-3", "air density")


def test_packed_and_missing_values_are_those_of_cf(tmp_path: Path) -> None:
    stored = values_of("int16")
    path = one(tmp_path / "v.nc", stored, scale_factor=0.5, add_offset=10.0, _FillValue=np.int16(7))
    expected = stored * 0.5 + 10
    expected[stored == 7] = np.nan
    np.testing.assert_array_equal(read_whole(path), expected)
    never = values_of("float32", (7, 6, 5))
    never[0, 0, 5] = netCDF4.default_fillvals["f4"]
    assert np.isnan(read_whole(one(tmp_path / "n.nc", never))[0, 0, 5])


def test_the_only_volume_is_taken_and_others_are_listed(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        variable(file, "flat", ("y", "x"), np.zeros((6, 7), np.int16))
        variable(file, "rho", ("z", "y", "x"), values_of("int16"))
        if several:
            variable(file, "u", ("z", "y", "x"), values_of("int16"))

    several = False
    np.testing.assert_array_equal(read_whole(written(tmp_path / "v.nc", fill)), values_of("int16"))
    several = True
    path = written(tmp_path / "w.nc", fill)
    with pytest.raises(BadInput) as refusal:
        open_volume(str(path))
    assert str(refusal.value) == f"{path}: holds rho (5 x 6 x 7), u (5 x 6 x 7); choose one, as in {path}#rho"
    with pytest.raises(BadInput, match=r"has no variable “v”; it holds flat \(6 x 7\), rho"):
        open_volume(f"{path}#v")


def test_a_variable_is_chosen_though_its_name_looks_like_an_option(tmp_path: Path) -> None:
    values = values_of("int16")

    def fill(file: Any) -> None:
        variable(file, "a", ("time", "z", "y", "x"), np.stack([values, values + 1]))
        variable(file, "a,time=1", ("time", "z", "y", "x"), np.stack([values + 2, values + 3]))
        variable(file, "t=3", ("z", "y", "x"), values + 4)

    path = written(tmp_path / "v.nc", fill)
    for part, more in (("a,time=0", 0), ("a,time=1,time=1", 3), ("t=3", 4), ("/t=3,spacing=1x1x2", 4)):
        np.testing.assert_array_equal(read_whole(f"{path}#{part}"), values + more)
    with pytest.raises(BadInput, match="“t=4” names no axis|choose one, as in"):
        open_volume(f"{path}#t=4")


def test_only_the_rows_of_a_box_are_read(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "v.nc", "w", format="NETCDF3_64BIT_OFFSET") as file:
        for name in "zyx":
            file.createDimension(name, 128)
        file.createVariable("rho", "i2", ("z", "y", "x"))[:] = 0
    reader = open_volume(str(tmp_path / "v.nc"))
    before = bytes_read()
    reader.read(Box((0, 0, 64), (128, 128, 72)))
    assert bytes_read() - before < 128 * 128 * 8 * 2 + 65536


def cut(path: Path, beyond: int) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[:-beyond])
    return path


def test_a_truncated_file_is_refused_by_its_bytes(tmp_path: Path) -> None:
    """netCDF-C itself would give zeros."""
    path = one(tmp_path / "v.nc", values_of("int32"))
    size = path.stat().st_size
    with pytest.raises(
        BadInput, match=rf"#rho: is truncated, its numbers end at byte {size} and the file at {size - 4};"
    ):
        open_volume(str(cut(path, 4)))
    records = np.zeros((4, 6, 7), np.int32)
    path = written(tmp_path / "r.nc", lambda file: variable(file, "movie", ("time", "y", "x"), records))
    with pytest.raises(BadInput, match="is truncated"):
        open_volume(str(cut(path, 4)))


def test_a_file_that_is_cut_short_while_it_is_open_is_told(tmp_path: Path) -> None:
    path = one(tmp_path / "v.nc", values_of("int32"))
    reader = open_volume(str(path))
    cut(path, 100)
    with pytest.raises(BadInput, match="it was cut short while it was read"):
        reader.read(reader.description.geometry.box)


def test_records_of_a_stream_are_counted_by_the_size_of_the_file(tmp_path: Path) -> None:
    movie = values_of("int16")
    path = written(tmp_path / "v.nc", lambda file: variable(file, "movie", ("time", "y", "x"), movie))
    raw = path.read_bytes()
    path.write_bytes(raw[:4] + b"\xff\xff\xff\xff" + raw[8:])
    np.testing.assert_array_equal(read_whole(path), movie)


def test_minc_is_refused_with_the_cure(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        variable(file, "image", ("z", "y", "x"), values_of("int16"))
        file.createVariable("rootvariable", "i4", ())

    with pytest.raises(BadInput, match="is MINC, .* mnc2nii"):
        open_volume(str(written(tmp_path / "v.mnc", fill)))


@pytest.fixture(scope="module")
def undamaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return one(tmp_path_factory.mktemp("netcdf") / "v.nc", values_of("int16"), units="m")


@given(data=st.data())
def test_a_damaged_header_is_read_or_refused(data: st.DataObject, undamaged: Path) -> None:
    raw = bytearray(undamaged.read_bytes())
    end = len(raw) - 2 * 7 * 6 * 5
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(4, end - 1))] = data.draw(st.integers(0, 255))
    damaged = undamaged.with_name("damaged.nc")
    damaged.write_bytes(raw)
    try:
        reader = open_volume(str(damaged))
        box = reader.description.geometry.box
        assert reader.read(box).shape == box.high[::-1]
    except BadInput as refusal:
        assert "\n" not in str(refusal)
