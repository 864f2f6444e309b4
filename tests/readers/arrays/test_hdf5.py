"""HDF5 datasets and NetCDF-4 variables: chosen by path, placed by their scales, read by hyperslab."""

import gzip
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole
from support.files.refusals import assert_refused_in_one_line
from support.files.volume_files import ALL_TYPES, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.arrays.hdf5_chunks import read_selection
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

h5py = pytest.importorskip("h5py")


def written(path: Path, fill: Callable[[Any], object]) -> Path:
    with h5py.File(path, "w") as file:
        fill(file)
    return path


def one(path: Path, values: Any, **settings: Any) -> Path:
    return written(path, lambda file: file.create_dataset("entry/data", data=values, **settings))


def netcdf(path: Path, stored: Any, scales: dict[str, tuple[Any, dict[str, Any]]], **attributes: Any) -> Path:
    """A variable `data` on these coordinate variables, as NetCDF-4 lays them out; None for a mere dimension."""

    def fill(file: Any) -> None:
        variable = file.create_dataset("data", data=stored)
        variable.attrs.update(attributes)
        for n, (name, (numbers, more)) in enumerate(scales.items()):
            only_a_name = f"This is a netCDF dimension but not a netCDF variable.{stored.shape[n]:10d}"
            scale = file.create_dataset(name, data=np.zeros(stored.shape[n]) if numbers is None else numbers)
            scale.make_scale(only_a_name if numbers is None else name)
            scale.attrs.update(more)
            variable.dims[n].attach_scale(scale)

    return written(path, fill)


@given(names=st.lists(st.text("ab,=/t3 ", min_size=1, max_size=8).filter(lambda name: name.strip(" /")), min_size=1))
def test_a_dataset_is_chosen_by_its_path_whatever_letters_that_has(names: list[str]) -> None:
    with TemporaryDirectory() as folder:
        path, paths = Path(folder, "volume.h5"), list[str]()
        with h5py.File(path, "w") as file:
            for name in names:
                with suppress(ValueError, TypeError, OSError):  # there is one, or a dataset lies on the way
                    file[name.strip(" ")] = np.full((2, 2, 2), len(paths), np.uint8)
                    paths.append(name.strip(" "))
        for n, name in enumerate(paths):
            assert (read_whole(f"{path}#{name}") == n).all()


def test_options_follow_a_path_that_looks_like_one(tmp_path: Path) -> None:
    """Of several paths that the name begins with the longest is meant."""
    values = values_of("int16")

    def fill(file: Any) -> None:
        file["a"] = np.zeros((5, *values.shape), values.dtype)
        file["a,t=3"] = np.stack([values, values + 1])

    path = written(tmp_path / "v.h5", fill)
    np.testing.assert_array_equal(read_whole(f"{path}#a,t=3,axis0=1"), values + 1)
    assert (read_whole(f"{path}#a,axis0=2") == 0).all()


@pytest.mark.parametrize("endian", ["<", ">"])
@pytest.mark.parametrize("scalar_type", ALL_TYPES)
def test_every_type_comes_back(scalar_type: str, endian: str, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    stored = values.astype(endian + values.dtype.str[1:])
    for settings in ({}, {"chunks": (2, 3, 4), "compression": "gzip", "shuffle": True}):
        path = one(tmp_path / "volume.h5", stored, **settings)
        assert described(path).scalar_type == scalar_type
        got = read_whole(path)
        assert got.dtype == values.dtype and got.dtype.isnative and got.flags.c_contiguous
        np.testing.assert_array_equal(got, values)
        part = open_volume(str(path)).read(Box((1, 2, 0), (5, 4, 3)))
        assert part.flags.c_contiguous
        np.testing.assert_array_equal(part, values[0:3, 2:4, 1:5])


def test_types_that_volumes_lack_become_others(tmp_path: Path) -> None:
    halves = np.linspace(-9, 9, 210, dtype=np.float16).reshape(5, 6, 7)
    np.testing.assert_array_equal(read_whole(one(tmp_path / "a.h5", halves)), halves.astype(np.float32))
    mask = values_of("uint8") > 50
    np.testing.assert_array_equal(read_whole(one(tmp_path / "b.h5", mask)), mask.astype(np.uint8))


def test_a_user_block_before_the_file_is_skipped(tmp_path: Path) -> None:
    values = values_of("int16")
    with h5py.File(tmp_path / "volume.mat", "w", userblock_size=512) as file:
        file["data"] = values
    np.testing.assert_array_equal(read_whole(tmp_path / "volume.mat"), values)


def test_datasets_are_named_by_path_group_or_not_at_all(tmp_path: Path) -> None:
    values = values_of("int16")

    def fill(file: Any) -> None:
        file["scan/raw"] = values
        file["scan/flat"] = values[0]
        file["result/map"] = values * 2

    path = written(tmp_path / "volume.h5", fill)
    for name in ("#/result/map", "#result/map", "#/result"):
        np.testing.assert_array_equal(read_whole(f"{path}{name}"), values * 2)
    assert described(f"{path}#/scan").density_name == "raw"
    with pytest.raises(BadInput) as refusal:
        open_volume(str(path))
    assert str(refusal.value) == (
        f"{path}: holds /result/map (5 x 6 x 7), /scan/raw (5 x 6 x 7); choose one, as in {path}#/result/map"
    )
    with pytest.raises(BadInput, match=r"has no “/scan/x”; it holds /result/map \(5 x 6 x 7\), /scan/flat"):
        open_volume(f"{path}#/scan/x")


def test_a_frame_is_chosen_by_index(tmp_path: Path) -> None:
    frames = np.arange(2 * 3 * 4 * 5, dtype=np.int16).reshape(2, 3, 4, 5)
    path = one(tmp_path / "volume.h5", frames)
    np.testing.assert_array_equal(read_whole(f"{path}#/entry/data,axis0=1"), frames[1])
    np.testing.assert_array_equal(read_whole(f"{path}#axes=tzyx,t=1"), frames[1])
    with pytest.raises(BadInput, match=r"choose an index of axis0, as in .*volume\.h5#/entry/data,axis0=0"):
        open_volume(str(path))


PROJECTED = {
    "z": (np.arange(5) * 10.0 - 7, {"units": "m"}),
    "y": (np.arange(6)[::-1] * 0.25, {"units": "km"}),
    "x": (np.arange(7) * 500.0, {"units": "m"}),
}


def test_coordinate_variables_place_the_grid(tmp_path: Path) -> None:
    description = described(netcdf(tmp_path / "v.nc", values_of("int16"), PROJECTED))
    assert description.geometry.index_to_physical == ((500, 0, 0), (0, -250, 0), (0, 0, 10))
    assert description.geometry.origin == (0, 1250, -7)
    assert description.unit == "m" and description.axes is None and not description.warnings


def test_axes_of_the_earth_are_told(tmp_path: Path) -> None:
    scales = {
        "depth": (np.arange(5) * 10.0, {"units": "m", "positive": "down"}),
        "lon": (np.arange(6, dtype=np.float32) / 3, {"units": "degrees_east"}),
        "lat": (60 - np.arange(7, dtype=np.float32) / 3, {"units": "degrees_north"}),
    }
    description = described(netcdf(tmp_path / "v.nc", values_of("int16"), scales, units="K", long_name="warmth"))
    assert description.axes is not None
    assert [axis.name for axis in description.axes] == ["lat", "lon", "depth"]
    assert [axis.unit for axis in description.axes] == ["deg", "deg", "m"]
    steps = [axis.step for axis in description.axes]
    assert steps == pytest.approx([-1 / 3, 1 / 3, 10], rel=tolerances.GEOMETRY_FLOAT32)
    towards = np.sign(description.geometry.index_to_physical)
    np.testing.assert_array_equal(towards, [[0, 1, 0], [-1, 0, 0], [0, 0, -1]])  # i along y, j along x, k down
    assert description.value_unit == "K" and description.density_name == "warmth"
    (warning,) = description.warnings
    assert "no unit in common" in warning


@pytest.mark.parametrize(
    ("name", "attributes", "k_towards_z"),
    [
        ("level", {"units": "millibars"}, -1),
        ("lev", {"units": "hPa", "positive": "up"}, 1),
        ("plev", {"units": "Pa", "standard_name": "air_pressure"}, -1),
        ("depth", {"units": "m"}, -1),
        ("altitude", {"units": "m"}, 1),
    ],
)
def test_pressures_and_depths_grow_downwards_unless_they_say_otherwise(
    name: str, attributes: dict[str, Any], k_towards_z: int, tmp_path: Path
) -> None:
    scales = {
        name: (np.arange(5) * 100.0 + 100, attributes),
        "y": (np.arange(6.0), {"units": "m"}),
        "x": (np.arange(7.0), {"units": "m"}),
    }
    geometry = described(netcdf(tmp_path / "v.nc", values_of("int16"), scales)).geometry
    assert np.sign(geometry.index_to_physical[2][2]) == k_towards_z


def test_dimensions_without_coordinates_give_only_names(tmp_path: Path) -> None:
    frames = np.arange(2 * 3 * 4 * 5, dtype=np.int16).reshape(2, 3, 4, 5)
    path = netcdf(tmp_path / "v.nc", frames, {name: (None, {}) for name in ("time", "z", "y", "x")})
    np.testing.assert_array_equal(read_whole(f"{path}#data,t=1"), frames[1])
    assert described(f"{path}#data,t=1").geometry.spacing == (1, 1, 1)


@pytest.mark.parametrize(
    ("numbers", "warning"),
    [
        ([0, 1, 2, 4, 8], r"z is unevenly spaced \(1 to 4\); drawn 2 apart"),
        ([0, 1, 2, np.nan, 8], "not usable"),
        ([3, 3, 3, 3, 3], "coordinates of z are not usable; its voxels are drawn one apart"),
        ([0, 1, 2, 3, np.inf], "not usable"),
        ([0, 1, np.inf, np.inf, 3], "not usable"),
        ([0, 1, 2, 1, 0.5], "not usable"),
        ([350, 355, 0, 5, 10], "not usable"),
    ],
)
def test_uneven_coordinates_are_told(numbers: list[float], warning: str, tmp_path: Path) -> None:
    scales = {**PROJECTED, "z": (np.array(numbers, np.float64), {"units": "m"})}
    with_warning = described(netcdf(tmp_path / "v.nc", values_of("int16"), scales))
    assert any(re.search(warning, one) for one in with_warning.warnings)


@pytest.mark.parametrize("scalar_type", ["float32", "float64", "int16"])
@pytest.mark.parametrize(
    "told", [("lon", {"units": "degrees_east"}), ("nav", {"standard_name": "longitude", "units": "degrees"})]
)
@pytest.mark.parametrize(("first", "step"), [(350, 5), (10, -5), (175, 3)])
def test_longitudes_go_on_where_they_are_counted_anew(
    first: int, step: int, told: tuple[str, dict[str, Any]], scalar_type: str, tmp_path: Path
) -> None:
    through = first + step * np.arange(7)
    name, attributes = told
    for turned in (through % 360, (through + 180) % 360 - 180):
        numbers = turned.astype(scalar_type)
        scales = {"z": (None, {}), "lat": (None, {}), name: (numbers, attributes)}
        description = described(netcdf(tmp_path / "v.nc", values_of("int16"), scales))
        assert description.axes is not None
        axis = description.axes[0]
        assert (axis.first, axis.step, axis.unit) == (float(numbers[0]), step, "deg")
        assert not any("uneven" in one or "usable" in one for one in description.warnings)


def test_packed_and_missing_values_are_what_cf_says(tmp_path: Path) -> None:
    stored = np.arange(5 * 6 * 7, dtype=np.int16).reshape(5, 6, 7)
    packed = {"scale_factor": 0.5, "add_offset": np.array([-20.0]), "_FillValue": np.int16(3), "missing_value": [4, 5]}
    path = netcdf(tmp_path / "v.nc", stored, PROJECTED, **packed, valid_max=np.int16(200))
    expected = stored * np.float32(0.5) - 20
    expected[(stored >= 3) & (stored <= 5) | (stored > 200)] = np.nan
    assert described(path).scalar_type == "float32"
    np.testing.assert_array_equal(read_whole(path), expected)


@pytest.mark.parametrize(
    ("stored_type", "attributes", "scalar_type"),
    [
        ("int32", {"scale_factor": 0.5}, "float64"),
        ("float32", {"scale_factor": 0.5}, "float32"),
        ("float64", {"_FillValue": 7.0}, "float64"),
        ("uint8", {"_FillValue": 7}, "float32"),
        ("uint8", {"_FillValue": 300}, "uint8"),
        ("int16", {"scale_factor": 1.0, "add_offset": 0.0}, "int16"),
        ("int8", {"_Unsigned": "true"}, "uint8"),
        ("int64", {"_FillValue": np.int64(-(2**63))}, "float64"),
    ],
)
def test_packing_decides_the_type(
    stored_type: str, attributes: dict[str, Any], scalar_type: str, tmp_path: Path
) -> None:
    path = netcdf(tmp_path / "v.nc", values_of(stored_type), PROJECTED, **attributes)
    assert described(path).scalar_type == scalar_type == read_whole(path).dtype.name


def test_unsigned_bytes_of_netcdf_3_are_unsigned(tmp_path: Path) -> None:
    values = values_of("uint8")
    fill = {"_Unsigned": "true", "_FillValue": np.int8(-1)}
    got = read_whole(netcdf(tmp_path / "v.nc", values.view(np.int8), PROJECTED, **fill))
    np.testing.assert_array_equal(got, np.where(values == 255, np.nan, values))


def test_what_netcdf_never_wrote_is_no_data(tmp_path: Path) -> None:
    fill = 9.969209968386869e36
    path = written(
        tmp_path / "v.nc",
        lambda file: file.create_dataset("data", (4, 4, 4), np.float32, chunks=(2, 4, 4), fillvalue=fill),
    )
    with h5py.File(path, "a") as file:
        file["data"][:2] = 1.0
    got = read_whole(path)
    assert (got[:2] == 1).all() and np.isnan(got[2:]).all()


def test_nexus_tells_what_to_plot_and_where(tmp_path: Path) -> None:
    values = values_of("int16")

    def fill(file: Any) -> None:
        file.attrs["default"] = "entry"
        file["entry/detector/frames"] = values * 0
        plot = file.create_group("entry/plot")
        file["entry"].attrs["default"] = "plot"
        plot["data"] = values
        plot["height"] = np.arange(6) * 2.0  # the edges of 5 bins
        plot["row"], plot["column"] = np.arange(6) * 0.5, np.arange(7) * 0.25
        for name in ("height", "row", "column"):
            plot[name].attrs["units"] = "um"
        plot.attrs.update({"NX_class": "NXdata", "signal": "data", "axes": ["height", "row", "column"]})

    path = written(tmp_path / "v.nxs", fill)
    np.testing.assert_array_equal(read_whole(path), values)
    geometry = described(path).geometry
    assert geometry.spacing == (0.25, 0.5, 2) and geometry.origin == (0, 0, 1) and described(path).unit == "µm"


def test_an_axis_that_nexus_names_by_a_point_has_no_coordinates(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        file["data"], file["row"] = values_of("int16"), np.arange(6) * 0.5
        file.attrs.update({"signal": "data", "axes": [".", "row", "nowhere"]})

    assert described(written(tmp_path / "v.nxs", fill)).geometry.spacing == (1, 0.5, 1)


def test_fiji_tells_the_size_of_elements(tmp_path: Path) -> None:
    path = one(tmp_path / "v.h5", values_of("int16"))
    with h5py.File(path, "a") as file:
        file["entry/data"].attrs["element_size_um"] = [2.0, 0.5, 0.25]
    assert described(path).geometry.spacing == (0.25, 0.5, 2) and described(path).unit == "µm"


@pytest.mark.parametrize(
    ("shape", "label", "part"),
    [
        ((5, 6, 7, 1), "", ""),
        ((5, 6, 7, 3), "", "axis3=0"),
        ((1, 5, 6, 7, 2), "", "axis4=0"),
        ((5, 6, 7, 9), "c", "c=0"),
        ((2, 5, 6, 7), "", "axis0=0"),
        ((2, 5, 6, 3), "x", "axis0=0"),
    ],
)
def test_sizes_of_elements_are_those_of_space(shape: tuple[int, ...], label: str, part: str, tmp_path: Path) -> None:
    path = one(tmp_path / "v.h5", np.zeros(shape, np.uint8))
    with h5py.File(path, "a") as file:
        file["entry/data"].attrs["element_size_um"] = [2.0, 0.5, 0.25]
        file["entry/data"].dims[len(shape) - 1].label = label
    told = described(f"{path}#{part}" if part else path)
    assert told.geometry.dims[1:] == (6, 5) and told.geometry.spacing == (0.25, 0.5, 2)


def test_matlab_writes_its_axes_the_other_way_round(tmp_path: Path) -> None:
    path = one(tmp_path / "v.mat", values_of("int16"))
    with h5py.File(path, "a") as file:
        file["entry/data"].attrs["MATLAB_class"] = np.bytes_(b"int16")
    assert described(f"{path}#spacing=1x2x3").geometry.index_to_physical == ((0, 1, 0), (2, 0, 0), (0, 0, 3))


SIEVE = 1 << 16  # bytes that HDF5 reads at once if wanted rows do not follow each other


@pytest.mark.parametrize("chunks", [None, (8, 32, 32)])
def test_only_the_hyperslab_is_read(chunks: tuple[int, int, int] | None, tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 60000, (64, 128, 128)).astype(np.uint16)
    path = one(tmp_path / "v.h5", values, chunks=chunks)
    box = Box((0, 32, 32), (128, 64, 40))
    read_whole(path)
    before = bytes_read()
    reader = open_volume(str(path))
    description = reader.description
    header = bytes_read() - before
    assert description.reads_sub_cubes and header < values.nbytes // 32
    reader.read(box)
    read_around = 2 * header if chunks else box.size[2] * SIEVE
    assert bytes_read() - before - header < 2 * box.voxels + read_around


class CountedWalks:
    """What stands for h5py's dataset or its id, and counts the calls for which HDF5 walks through all chunks."""

    WALKS = ("chunk_iter", "get_chunk_info", "get_chunk_info_by_coord", "get_num_chunks")

    def __init__(self, real: Any, made: list[str]) -> None:
        self._real, self._made = real, made

    def __getattr__(self, name: str) -> Any:
        if name in self.WALKS:
            self._made.append(name)
        found = getattr(self._real, name)
        return CountedWalks(found, self._made) if name == "id" else found

    def __getitem__(self, selection: Any) -> Any:
        return self._real[selection]


@pytest.mark.parametrize("settings", [{"shuffle": True}, {"fletcher32": True}], ids=["shuffled", "checksums"])
@pytest.mark.parametrize("written_part", [slice(None), slice(3, 11)], ids=["whole", "in part"])
def test_however_many_chunks_there_are_their_index_is_walked_once(
    written_part: slice, settings: dict[str, bool], tmp_path: Path
) -> None:
    values, made = np.arange(4096, dtype=np.uint16).reshape(16, 16, 16), list[str]()
    with h5py.File(tmp_path / "v.h5", "w") as file:
        stored = file.create_dataset("v", values.shape, "u2", chunks=(2, 2, 2), compression="gzip", **settings)
        stored[written_part] = values[written_part]
    with h5py.File(tmp_path / "v.h5") as file:
        got = read_selection(CountedWalks(file["v"], made), (slice(0, 15), slice(1, 16), 5))
        np.testing.assert_array_equal(got, file["v"][:15, 1:, 5])
    assert len(made) <= 1


@given(st.lists(st.sampled_from(["set_deflate", "set_shuffle", "set_fletcher32"]), min_size=1, unique=True))
def test_filters_in_any_order_come_back(tmp_path_factory: pytest.TempPathFactory, filters: list[str]) -> None:
    path, values = tmp_path_factory.mktemp("filters") / "v.h5", values_of("int16", (20, 13, 9))
    with h5py.File(path, "w") as file:
        creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        creation.set_chunk((4, 5, 6))
        for name in filters:
            getattr(creation, name)(*[9] if name == "set_deflate" else [])
        space = h5py.h5s.create_simple(values.shape)
        h5py.Dataset(h5py.h5d.create(file.id, b"v", h5py.h5t.NATIVE_INT16, space, creation))[...] = values
    np.testing.assert_array_equal(read_whole(path), values)


def test_one_chunk_says_why_it_is_read_whole(tmp_path: Path) -> None:
    description = described(one(tmp_path / "v.h5", values_of("int16"), chunks=(5, 6, 7), compression="gzip"))
    assert not description.reads_sub_cubes and description.why_whole == "all its voxels are in one chunk"


NOISE = np.random.default_rng(0).integers(0, 30000, (20, 20, 20)).astype(np.int16)
OF_TESTS = 300  # of the numbers that HDF5 keeps for tests: netCDF4, which other tests load, brings 32001


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def damaged(path: Path) -> Path:
    raw = bytearray(path.read_bytes())
    raw[len(raw) * 2 // 3 : len(raw) * 2 // 3 + 64] = bytes(64)
    path.write_bytes(raw)
    return path


def zipped(path: Path) -> Path:
    path.write_bytes(gzip.compress(path.read_bytes()))
    return path


def of_another_filter(path: Path) -> Path:
    """Says that its chunks are compressed by a filter that nobody has, in the place of shuffling."""
    one(path, NOISE, chunks=(5, 20, 20), shuffle=True)
    raw = path.read_bytes()
    at = raw.index(b"shuffle") - 8
    path.write_bytes(raw[:at] + OF_TESTS.to_bytes(2, "little") + raw[at + 2 :])
    return path


def linked(path: Path) -> Path:
    return written(path, lambda file: file.__setitem__("data", h5py.ExternalLink("nowhere.h5", "/data")))


def virtual(path: Path, *names: str) -> Path:
    """A dataset whose sheets are these files' first ones."""
    layout = h5py.VirtualLayout((len(names), *NOISE.shape[1:]), NOISE.dtype)
    for n, name in enumerate(names):
        layout[n] = h5py.VirtualSource(name, "entry/data", NOISE.shape)[0]
    return written(path, lambda file: file.create_virtual_dataset("data", layout))


def empty(path: Path) -> Path:
    return written(path, lambda file: file.create_dataset("data", (90000, 90000, 90000), np.float64, chunks=True))


REFUSALS: dict[str, tuple[Callable[[Path], Path], str, str]] = {
    "truncated": (lambda p: cut(one(p, NOISE), 0.7), "", "is truncated, it has"),
    "damaged": (
        lambda p: damaged(one(p, NOISE, chunks=(5, 20, 20), compression="gzip", fletcher32=True)),
        "",
        "HDF5 cannot read it",
    ),
    "gzip": (lambda p: zipped(one(p, NOISE)), "", "is a gzip of"),
    "no arrays": (lambda p: written(p, lambda file: file.create_group("a")), "", "it holds nothing"),
    "a list": (lambda p: one(p, NOISE[0, 0]), "", "no dataset with three axes of numbers; it holds /entry/data (20)"),
    "a flat dataset": (lambda p: one(p, NOISE[0]), "#/entry/data", "a 2-D image, volsplat needs a volume"),
    "a number": (lambda p: one(p, 3.0), "#/entry/data", "a single number"),
    "complex": (lambda p: one(p, NOISE.astype(np.complex64)), "#/entry/data", "has complex numbers (complex64)"),
    "compound": (
        lambda p: one(p, np.zeros((2, 2, 2), [("r", "u1"), ("g", "u1")])),
        "#/entry/data",
        "voxels of several fields (r, g)",
    ),
    "texts": (lambda p: one(p, np.full((2, 2, 2), b"a")), "#/entry/data", "voxels of type bytes8"),
    "colour": (lambda p: one(p, np.zeros((5, 6, 7, 3), np.uint8)), "", "choose an index of axis3, as in"),
    "never written": (empty, "", "no voxel of it was ever written"),
    "a lost link": (linked, "#data", "is a link to /data of nowhere.h5, which is not there, or lacks that; put"),
    "nothing but a lost link": (linked, "", "it holds data, which leads to /data of nowhere.h5, which is not there"),
    "voxels that are elsewhere": (
        lambda p: virtual(p, "gone.h5"),
        "",
        "are not there, or lack them: gone.h5; put",
    ),
    "an unknown filter": (
        of_another_filter,
        "",
        f"filter {OF_TESTS} (shuffle), which is not installed; convert it",
    ),
    "MINC": (lambda p: written(p, lambda file: file.create_group("minc-2.0")), "", "is MINC, whose values are scaled"),
    "zero scale": (
        lambda p: netcdf(p, NOISE[:5, :6, :7], PROJECTED, scale_factor=0.0),
        "",
        "scale_factor is 0",
    ),
    "scale that is no number": (
        lambda p: netcdf(p, NOISE[:5, :6, :7], PROJECTED, scale_factor="half"),
        "",
        "attribute scale_factor is no number but “half”",
    ),
    "scale that is not finite": (
        lambda p: netcdf(p, NOISE[:5, :6, :7], PROJECTED, add_offset=np.nan),
        "",
        "attribute add_offset is nan",
    ),
    "zero spacing": (lambda p: one(p, NOISE), "#spacing=0x1x1", "its spacing cannot be used"),
    "an option that is none": (lambda p: one(p, NOISE), "#/entry/data,level=1", "“level=1” names no axis"),
}


def test_links_lead_to_the_other_files_own_dataset(tmp_path: Path) -> None:
    """As detectors write them: a master file beside the files of the data."""
    one(tmp_path / "data_1.h5", NOISE)
    master = one(tmp_path / "master.h5", NOISE[:, :, ::-1])
    with h5py.File(master, "r+") as file:
        file["entry/first"] = h5py.ExternalLink("data_1.h5", "/entry/data")
    assert np.array_equal(read_whole(f"{master}#/entry/first"), NOISE)
    with pytest.raises(BadInput, match=r"holds /entry/data \(.*\), /entry/first \(.*\); choose one"):
        open_volume(str(master))
    with h5py.File(master, "r+") as file:
        del file["entry/data"]
    assert np.array_equal(read_whole(str(master)), NOISE)


def test_links_to_groups_and_to_what_is_there_already_lead_to_each_dataset_once(tmp_path: Path) -> None:
    one(tmp_path / "data.h5", NOISE)
    links = {"group": ("data.h5", "/entry"), "again": ("data.h5", "/entry/data"), "ring": ("v.h5", "/ring")}

    def fill(file: Any) -> None:
        for name, to in links.items():
            file[name] = h5py.ExternalLink(*to)

    assert np.array_equal(read_whole(str(written(tmp_path / "v.h5", fill))), NOISE)


@pytest.mark.parametrize("name", ["plot/data", "plot/alias", "plot/far", "way/data", "way/alias", "data", "soft"])
def test_through_links_of_links_a_dataset_is_found_with_its_axes(name: str, tmp_path: Path) -> None:
    """The group has another path in its own file, where that of the name is none."""
    one(tmp_path / "far.h5", NOISE)

    def fill(file: Any) -> None:
        file["deep/plot/data"], file["deep/plot/row"] = NOISE, np.arange(NOISE.shape[1]) * 0.5
        group = file["deep/plot"]
        group["alias"], group["far"] = h5py.SoftLink("data"), h5py.ExternalLink("far.h5", "/entry/data")
        group.attrs["axes"] = [".", "row", "."]

    def link(file: Any) -> None:
        file["plot"] = h5py.ExternalLink("v.h5", "/deep/plot")
        file["data"] = h5py.ExternalLink("v.h5", "/deep/plot/data")
        file["way"], file["soft"] = h5py.SoftLink("/plot"), h5py.SoftLink("/plot/alias")

    written(tmp_path / "v.h5", fill)
    top = f"{written(tmp_path / 'top.h5', link)}#{name}"
    assert np.array_equal(read_whole(top), NOISE)
    assert described(top).geometry.spacing == ((1, 1, 1) if name == "soft" else (1, 0.5, 1))


def test_a_link_to_a_group_leads_to_what_the_groups_own_links_name(tmp_path: Path) -> None:
    written(
        tmp_path / "v.h5",
        lambda file: (file.create_dataset("data", data=NOISE), file.__setitem__("plot/shown", h5py.SoftLink("/data"))),
    )
    top = written(tmp_path / "top.h5", lambda file: file.__setitem__("link", h5py.ExternalLink("v.h5", "/plot")))
    assert np.array_equal(read_whole(str(top)), NOISE)


def test_a_virtual_dataset_has_its_files_beside_its_own(tmp_path: Path) -> None:
    """Not beside the one that links to it; and a percent sign in a name is written twice."""
    (tmp_path / "run").mkdir()
    one(tmp_path / "run" / "100%.h5", NOISE)
    virtual(tmp_path / "run" / "v.h5", "100%%.h5")
    master = written(tmp_path / "m.h5", lambda file: file.__setitem__("v", h5py.ExternalLink("run/v.h5", "/data")))
    volume = open_volume(str(master))
    assert not volume.description.warnings
    assert np.array_equal(volume.read(volume.description.geometry.box), NOISE[:1])


def of_another_kind(path: Path) -> None:
    path.write_bytes(b"no HDF5 at all")


def without_the_dataset(path: Path) -> None:
    written(path, lambda file: file.create_dataset("entry/other", data=NOISE))


def cut_short(path: Path) -> None:
    one(path, NOISE)
    path.write_bytes(path.read_bytes()[:1000])


def test_a_link_into_a_file_that_is_cut_short_hides_no_other_dataset(tmp_path: Path) -> None:
    cut_short(tmp_path / "cut.h5")
    master = one(tmp_path / "master.h5", NOISE)
    with h5py.File(master, "r+") as file:
        file["cut"] = h5py.ExternalLink("cut.h5", "/entry/data")
    assert np.array_equal(read_whole(str(master)), NOISE)


@pytest.mark.parametrize("make", [of_another_kind, without_the_dataset, cut_short])
def test_files_that_are_there_and_lack_the_voxels_are_told(make: Callable[[Path], None], tmp_path: Path) -> None:
    one(tmp_path / "here.h5", NOISE)
    make(tmp_path / "odd.h5")
    with pytest.raises(BadInput, match=r"its voxels are in files that are not there, or lack them: odd.h5"):
        open_volume(str(virtual(tmp_path / "v.h5", "odd.h5")))
    told = open_volume(str(virtual(tmp_path / "w.h5", "odd.h5", "here.h5"))).description.warnings
    assert told == ("1 of 2 files with its voxels are not there, or lack them (odd.h5): 0 is shown instead",)


def test_what_some_lost_files_held_is_told(tmp_path: Path) -> None:
    one(tmp_path / "here.h5", NOISE)
    volume = open_volume(str(virtual(tmp_path / "v.h5", "here.h5", "gone.h5", "here.h5")))
    assert "1 of 2 files with its voxels are not there, or lack them (gone.h5)" in volume.description.warnings[0]
    sheets = volume.read(volume.description.geometry.box)
    assert np.array_equal(sheets[0], NOISE[0]) and not sheets[1].any()


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, part, cause = REFUSALS[case]
    assert_refused_in_one_line(lambda path: read_whole(f"{path}{part}"), make(tmp_path / "v.h5"), cause, capfd)


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = one(tmp_path / "v.h5", NOISE)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(BadInput, match=r"HDF5 needs h5py, which is not installed: pip install 'volsplat\[formats\]'"):
        open_volume(str(path))
