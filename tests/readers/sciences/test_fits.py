"""FITS cubes: the values that astropy reads, the sky as astronomers draw it, and what is refused."""

import gzip
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole
from support.files.refusals import assert_refused_in_one_line
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.geometry.matrices import Vector, column, determinant, minus
from volsplat.protocol.text.errors import BadInput

NGC_6946 = "galaxy/ngc6946.fits"
L1448 = "galaxy/l1448_13co.fits"
SHAPE = (5, 6, 7)  # k, j, i
ARCSECOND = 1 / 3600

Header = dict[str, Any]

SKY: Header = {
    "CTYPE1": "RA---TAN",
    "CTYPE2": "DEC--TAN",
    "CRVAL1": 150.0,
    "CRVAL2": 60.0,
    "CRPIX1": 4.0,
    "CRPIX2": 3.5,
    "CDELT1": -2 * ARCSECOND,
    "CDELT2": 3 * ARCSECOND,
    "CUNIT1": "deg",
    "CUNIT2": "deg",
}
VELOCITY: Header = {"CTYPE3": "VRAD", "CRVAL3": 1000.0, "CRPIX3": 1.0, "CDELT3": 500.0, "CUNIT3": "m/s"}
FREQUENCY: Header = {"CTYPE3": "FREQ", "CRVAL3": 1.42e9, "CRPIX3": 1.0, "CDELT3": -2e6, "CUNIT3": "Hz"}


def values_of(kind: str = "float32", shape: tuple[int, ...] = SHAPE) -> Voxels:
    count = math.prod(shape)
    if np.dtype(kind).kind == "f":
        values = np.linspace(-1, 1, count).astype(kind)
        values[3] = np.nan
    else:
        values = np.arange(count).astype(kind)
        values[:2] = np.iinfo(kind).min, np.iinfo(kind).max
    return values.reshape(shape)


def written(path: Path, values: Voxels, *headers: Header) -> Path:
    hdu = fits.PrimaryHDU(values)
    for header in headers:
        hdu.header.update(header)
    hdu.writeto(path, overwrite=True)
    return path


def assert_read(name: object, values: Voxels) -> None:
    got = read_whole(name)
    assert got.dtype == values.dtype.newbyteorder("=") and got.dtype.isnative and got.flags.c_contiguous
    assert got.dtype.name == described(name).scalar_type
    np.testing.assert_array_equal(got, values)


def step(name: object, axis: int) -> Vector:
    return column(described(name).geometry.index_to_physical, axis)


@pytest.mark.parametrize("name", [NGC_6946, L1448])
def test_a_real_cube_has_the_values_that_astropy_reads(name: str, shared_data: Path) -> None:
    expected = fits.getdata(shared_data / name)
    got = read_whole(shared_data / name)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, expected, rtol=tolerances.FLOAT32_SCALED, atol=tolerances.FLOAT32_SCALED)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
    box = Box((10, 20, 30), (37, 41, 52))
    np.testing.assert_array_equal(open_volume(str(shared_data / name)).read(box), got[30:52, 20:41, 10:37])


def test_the_axes_of_ngc_6946_are_those_of_its_header(shared_data: Path) -> None:
    description = described(shared_data / NGC_6946)
    assert description.geometry.dims == (100, 100, 101)
    assert (description.unit, description.value_unit, description.density_name) == ("arcmin", "JY/BEAM", "intensity")
    assert description.axes is not None
    ra, dec, velocity = description.axes
    assert (ra.name, dec.name, velocity.name, velocity.unit) == ("RA", "Dec", "velocity", "km/s")
    # The reference pixel, 51 counted from 1, is at 308.7179 and 60.1539 degrees; a step west is 1/cos(Dec) degrees.
    assert ra.first + 50 * ra.step == pytest.approx(360 - 51.28208479590, rel=tolerances.GEOMETRY_PRINTED)
    assert ra.step == pytest.approx(-0.007165998823 / math.cos(math.radians(60.1539)), rel=tolerances.SKY_CURVATURE)
    assert dec.first + 50 * dec.step == pytest.approx(60.15388802060, rel=tolerances.GEOMETRY_PRINTED)
    assert velocity.step == pytest.approx(4.199999809)
    assert velocity.first == pytest.approx(-243 + 21 * 4.199999809)
    low, high = np.nanmin(read_whole(shared_data / NGC_6946)), np.nanmax(read_whole(shared_data / NGC_6946))
    assert (low, high) == pytest.approx((-0.0412, 0.1569), rel=tolerances.RANGE_PRINTED)


def test_the_spectral_axis_is_as_long_as_the_sky_axes_on_average_and_this_is_told(shared_data: Path) -> None:
    for name in (NGC_6946, L1448):
        description = described(shared_data / name)
        extents = [n * d for n, d in zip(description.geometry.dims, description.geometry.spacing, strict=True)]
        assert extents[2] == pytest.approx((extents[0] + extents[1]) / 2, rel=tolerances.GEOMETRY_PRINTED)
        assert "velocity has no length on the sky" in description.warnings[0]


def test_the_sky_is_drawn_west_to_the_right_north_up_and_receding_away(shared_data: Path) -> None:
    for name in (NGC_6946, L1448):
        west, north, away = (step(shared_data / name, axis) for axis in range(3))
        assert west[0] > 0.1 and abs(west[2]) < 0.1 * west[0]
        assert north[2] > 0.1 and abs(north[0]) < 0.1 * north[2]
        assert away[0] == away[2] == 0 and away[1] > 0


def test_grid_points_lie_where_their_coordinates_are_on_the_sky(shared_data: Path) -> None:
    from astropy.wcs import WCS

    header = fits.getheader(shared_data / L1448)
    geometry = described(shared_data / L1448).geometry
    middle = (52.0, 52.0, 26.0)
    sky = WCS(header).celestial
    ra0, dec0 = sky.wcs_pix2world([middle[:2]], 0)[0]
    for point in ((0.0, 0.0, 26.0), (104.0, 0.0, 26.0), (0.0, 104.0, 26.0)):
        ra, dec = sky.wcs_pix2world([point[:2]], 0)[0]
        west, _, north = minus(geometry.physical(point), geometry.physical(middle))
        # Half a degree from the middle a parallel bends by a few thousandths of that.
        assert west / 60 == pytest.approx((ra0 - ra) * math.cos(math.radians((dec + dec0) / 2)), abs=0.005)
        assert north / 60 == pytest.approx(dec - dec0, abs=0.005)


def test_columns_that_run_east_are_drawn_to_the_left(tmp_path: Path) -> None:
    for sign in (-1, 1):
        east = {**SKY, "CDELT1": sign * 2 * ARCSECOND}
        path = written(tmp_path / "cube.fits", values_of(), east, VELOCITY)
        assert step(path, 0) == pytest.approx((-sign * 2.0, 0, 0), abs=tolerances.SKY_STEP)
        assert step(path, 1) == pytest.approx((0, 0, 3.0), abs=tolerances.SKY_STEP)
        assert math.copysign(1, determinant(described(path).geometry.index_to_physical)) == sign
        assert described(path).unit == "arcsec"


def test_a_turned_camera_keeps_its_true_directions(tmp_path: Path) -> None:
    turn = math.radians(30)
    pixels = {"PC1_1": math.cos(turn), "PC1_2": -math.sin(turn), "PC2_1": math.sin(turn), "PC2_2": math.cos(turn)}
    square = {**SKY, "CDELT1": -2 * ARCSECOND, "CDELT2": 2 * ARCSECOND}
    path = written(tmp_path / "cube.fits", values_of(), square, VELOCITY, pixels)
    assert step(path, 0) == pytest.approx((2 * math.cos(turn), 0, 2 * math.sin(turn)), abs=tolerances.SKY_STEP)
    assert step(path, 1) == pytest.approx((-2 * math.sin(turn), 0, 2 * math.cos(turn)), abs=tolerances.SKY_STEP)
    axes = described(path).axes
    assert axes is not None and [axis.unit for axis in axes[:2]] == ["arcsec", "arcsec"]


THIRD_AXES = {
    "velocity": (VELOCITY, "velocity", "km/s", 1.0, 0.5, True),
    "approaching": ({**VELOCITY, "CDELT3": -500.0}, "velocity", "km/s", 1.0, -0.5, True),
    "frequency": (FREQUENCY, "frequency", "GHz", 1.42, -0.002, False),
    "optical": (
        {"CTYPE3": "AWAV", "CRVAL3": 4750.0, "CRPIX3": 1.0, "CDELT3": 1.25, "CUNIT3": "Angstrom"},
        "wavelength", "Å", 4750.0, 1.25, True,
    ),
    "infrared": (
        {"CTYPE3": "WAVE", "CRVAL3": 2.1e-6, "CRPIX3": 1.0, "CDELT3": 5e-10, "CUNIT3": "m"},
        "wavelength", "µm", 2.1, 0.0005, True,
    ),
    "X-rays": (
        {"CTYPE3": "ENER", "CRVAL3": 500.0, "CRPIX3": 1.0, "CDELT3": 20.0, "CUNIT3": "eV"},
        "energy", "keV", 0.5, 0.02, False,
    ),
    "time": (
        {"CTYPE3": "EXPOSURE", "CRVAL3": 7.0, "CRPIX3": 1.0, "CDELT3": 2.0, "CUNIT3": "s"},
        "EXPOSURE", "s", 7.0, 2.0, True,
    ),
    "nothing": ({}, "axis 3", "", 1.0, 1.0, True),
}  # fmt: skip


@pytest.mark.parametrize("case", THIRD_AXES)
def test_a_third_axis_is_told_in_its_unit_and_recedes(case: str, tmp_path: Path) -> None:
    header, name, unit, first, each, recedes = THIRD_AXES[case]
    path = written(tmp_path / "cube.fits", values_of(), SKY, header)
    axes = described(path).axes
    assert axes is not None
    assert (axes[2].name, axes[2].unit) == (name, unit)
    assert (axes[2].first, axes[2].step) == pytest.approx((first, each), rel=tolerances.ELECTRON_VOLT)
    assert (step(path, 2)[1] > 0) == ((each > 0) == recedes)


def test_a_galaxy_is_the_same_by_velocity_and_by_frequency(tmp_path: Path) -> None:
    by_velocity = written(tmp_path / "velocity.fits", values_of(), SKY, VELOCITY)
    by_frequency = written(tmp_path / "frequency.fits", values_of(), SKY, FREQUENCY)  # falls where velocity grows
    assert described(by_velocity).geometry == described(by_frequency).geometry


def test_uneven_channels_are_told(tmp_path: Path) -> None:
    header = {"CTYPE3": "WAVE-LOG", "CRVAL3": 4000.0, "CRPIX3": 1.0, "CDELT3": 2000.0, "CUNIT3": "Angstrom"}
    path = written(tmp_path / "cube.fits", values_of(), SKY, header)
    assert "wavelength is not evenly stepped" in described(path).warnings[1]


def test_a_spectral_axis_may_come_first(tmp_path: Path) -> None:
    moved = {f"{key[:-1]}{int(key[-1]) % 3 + 1}": value for key, value in {**SKY, **VELOCITY}.items()}
    path = written(tmp_path / "cube.fits", values_of(), moved)
    assert [axis.name for axis in described(path).axes or ()] == ["velocity", "RA", "Dec"]
    depth = (6 * 2 + 5 * 3) / 2 / 7
    for axis, expected in enumerate([(0, depth, 0), (2, 0, 0), (0, 0, 3)]):
        assert step(path, axis) == pytest.approx(expected, abs=tolerances.SKY_STEP)


def test_galactic_longitude_grows_to_the_left_too(tmp_path: Path) -> None:
    galactic = {**SKY, "CTYPE1": "GLON-CAR", "CTYPE2": "GLAT-CAR", "CRVAL1": 0.0, "CRVAL2": 0.0}
    path = written(tmp_path / "cube.fits", values_of(), galactic, VELOCITY)
    axes = described(path).axes
    assert axes is not None and [axis.name for axis in axes[:2]] == ["GLON", "GLAT"]
    assert axes[0].step == pytest.approx(-2 * ARCSECOND) and step(path, 0)[0] > 0
    assert axes[0].first == pytest.approx(6 * ARCSECOND, rel=tolerances.GEOMETRY_PRINTED)


def test_three_lengths_are_a_place_in_space(tmp_path: Path) -> None:
    header: Header = {}
    for n, (name, delta, unit) in enumerate((("X", 2.0, "pc"), ("Y", 0.003, "kpc"), ("Z", 4.0, "pc"))):
        header |= {f"CTYPE{n + 1}": name, f"CDELT{n + 1}": delta, f"CUNIT{n + 1}": unit, f"CRPIX{n + 1}": 1.0}
        header |= {f"CRVAL{n + 1}": 10.0 * delta}
    description = described(written(tmp_path / "cube.fits", values_of(), header))
    assert description.unit == "pc" and description.warnings == ()
    expected = np.diag([2.0, 3.0, 4.0])
    np.testing.assert_allclose(description.geometry.index_to_physical, expected, rtol=1e-12, atol=1e-12)
    assert description.geometry.origin == pytest.approx((20.0, 30.0, 40.0))


def test_without_coordinates_voxels_are_cubes_and_this_is_told(tmp_path: Path) -> None:
    description = described(written(tmp_path / "cube.fits", values_of()))
    assert description.geometry.spacing == (1, 1, 1) and description.unit == "" and description.axes is None
    assert determinant(description.geometry.index_to_physical) > 0
    assert "drawn as cubes" in description.warnings[0]


@pytest.mark.parametrize("header", [{"CDELT3": 0.0}, {"CUNIT1": "furlong"}, {"CTYPE2": "GLAT-TAN"}])
def test_coordinates_that_make_no_sense_are_told(header: Header, tmp_path: Path) -> None:
    description = described(written(tmp_path / "cube.fits", values_of(), SKY, VELOCITY, header))
    assert description.geometry.spacing == (1, 1, 1)
    assert "its world coordinates cannot be used" in description.warnings[0]


@pytest.mark.parametrize(
    "kind", ["uint8", "int8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
)
def test_every_scalar_type_comes_back(kind: str, tmp_path: Path) -> None:
    values = values_of(kind)
    path = written(tmp_path / "cube.fits", values)
    assert_read(path, values)
    np.testing.assert_array_equal(open_volume(str(path)).read(Box((1, 2, 3), (4, 4, 5))), values[3:5, 2:4, 1:4])


@pytest.mark.parametrize("blank", [-32768, 0, 17])
def test_scaled_integers_become_floats_and_blanks_nan(blank: int, tmp_path: Path) -> None:
    stored = values_of("int16")
    path = written(tmp_path / "cube.fits", stored)
    with fits.open(path, mode="update", do_not_scale_image_data=True) as hdus:
        hdus[0].header.update({"BSCALE": 0.25, "BZERO": 3.5, "BLANK": blank})
    expected = (stored * 0.25 + 3.5).astype(np.float32)
    expected[stored == blank] = np.nan
    assert_read(path, expected)


def test_a_blank_alone_makes_floats(tmp_path: Path) -> None:
    stored = values_of("int32")
    expected = stored.astype(np.float64)
    expected[stored == 5] = np.nan
    assert_read(written(tmp_path / "cube.fits", stored, {"BLANK": 5}), expected)


def test_floats_may_be_scaled(tmp_path: Path) -> None:
    path = written(tmp_path / "cube.fits", values_of("float64"))
    with fits.open(path, mode="update", do_not_scale_image_data=True) as hdus:
        hdus[0].header.update({"BSCALE": 2.0, "BZERO": 1.0})
    assert_read(path, values_of("float64") * 2 + 1)


def test_degenerate_axes_are_left_out(tmp_path: Path) -> None:
    stokes = {"CTYPE4": "STOKES", "CRVAL4": 1.0, "CRPIX4": 1.0, "CDELT4": 1.0}
    values = values_of()
    path = written(tmp_path / "cube.fits", values[None], SKY, VELOCITY, stokes)
    assert_read(path, values)
    plain = written(tmp_path / "plain.fits", values, SKY, VELOCITY)
    assert described(path).geometry == described(plain).geometry
    between = {key.replace("4", "3"): value for key, value in stokes.items()}
    fourth = {key.replace("3", "4"): value for key, value in VELOCITY.items()}
    path = written(tmp_path / "between.fits", values[:, None], SKY, between, fourth)
    assert_read(path, values)
    assert described(path).geometry == described(plain).geometry


def test_a_plane_of_a_further_axis_is_chosen(tmp_path: Path) -> None:
    values = values_of(shape=(4, *SHAPE))
    path = written(tmp_path / "last.fits", values, SKY, VELOCITY, {"CTYPE4": "STOKES"})
    with pytest.raises(BadInput, match=r"choose a plane of axis 4, 0 to 3, as in .*last.fits#axis4=0"):
        open_volume(str(path))
    assert_read(f"{path}#axis4=2", values[2])
    with pytest.raises(BadInput, match="planes along axis 4 are numbered 0 to 3; “4” is none of them"):
        open_volume(f"{path}#axis4=4")
    values = np.ascontiguousarray(values.transpose(1, 0, 2, 3))
    fourth = {key.replace("3", "4"): value for key, value in VELOCITY.items()}
    path = written(tmp_path / "third.fits", values, SKY, {"CTYPE3": "STOKES"}, fourth)
    packed = tmp_path / "third.fits.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    for name in (path, packed):
        assert_read(f"{name}#axis3=1", values[:, 1])
        got = open_volume(f"{name}#axis3=3").read(Box((1, 2, 1), (4, 4, 4)))
        np.testing.assert_array_equal(got, values[1:4, 3, 2:4, 1:4])
    with pytest.raises(BadInput, match="choose a plane of axis 3"):
        open_volume(str(path))


def several(path: Path) -> Path:
    hdus = [
        fits.PrimaryHDU(),
        fits.ImageHDU(values_of(), name="DATA"),
        fits.ImageHDU(values_of() ** 2, name="STAT"),
        fits.ImageHDU(values_of(shape=(6, 7)), name="WHITE"),
        fits.BinTableHDU.from_columns([fits.Column("a", "E", array=[1.0])], name="CATALOGUE"),
    ]
    fits.HDUList(hdus).writeto(path)
    return path


@pytest.mark.parametrize("zipped", [False, True])
def test_one_of_several_cubes_is_chosen(zipped: bool, tmp_path: Path) -> None:
    path = several(tmp_path / "cube.fits")
    if zipped:
        packed = tmp_path / "cube.fits.gz"
        packed.write_bytes(gzip.compress(path.read_bytes()))
        path = packed
        assert not described(f"{path}#1").reads_sub_cubes and "gzip" in described(f"{path}#1").why_whole
    for part in ("2", "STAT", "stat"):
        assert_read(f"{path}#{part}", values_of() ** 2)
    assert_read(f"{path}#DATA", values_of())
    assert_read(path, values_of())
    assert described(str(path)).warnings[0] == f"of 2 cubes DATA is shown; {path.name}#STAT shows STAT"
    for name, cause in (
        (f"{path}#WHITE", "a 2-D image, volsplat needs a volume"),
        (f"{path}#CATALOGUE", "is no image"),
        (f"{path}#0", "is no image"),
        (f"{path}#ERROR", "has no HDU “ERROR”; its cubes are HDU 1"),
    ):
        with pytest.raises(BadInput, match=cause):
            open_volume(name)


def test_data_are_told_from_what_is_stored_beside_them(tmp_path: Path) -> None:
    def of(*names: str, classes: tuple[str, ...] = (), longer: bool = False) -> Path:
        hdus = [fits.ImageHDU(values_of(shape=(5, 6, 7 + longer * n)), name=name) for n, name in enumerate(names)]
        for hdu, said in zip(hdus, classes, strict=False):
            hdu.header["HDUCLAS2"] = said
        path = tmp_path / f"{'-'.join(names)}-{len(classes)}-{longer}.fits"
        fits.HDUList([fits.PrimaryHDU(), *hdus]).writeto(path)
        return path

    assert described(of("SCI", "ERR", "DQ")).format == "FITS, HDU 1 (SCI)"
    assert described(of("IVAR", "FLUX", "MASK")).format == "FITS, HDU 2 (FLUX)"
    assert described(of("A", "B", classes=("ERROR", "DATA"))).format == "FITS, HDU 2 (B)"
    for unclear in (of("SCI", "SCI"), of("A", "B"), of("DATA", "STAT", longer=True)):
        with pytest.raises(BadInput, match="holds 2 cubes: HDU 1 .*; choose one, as in .*fits#1"):
            open_volume(str(unclear))


def compressed(path: Path, values: Voxels, **how: Any) -> Path:
    cube = fits.CompImageHDU(values, **how)
    cube.header.update({**SKY, **VELOCITY})
    fits.HDUList([fits.PrimaryHDU(), cube]).writeto(path)
    return path


@pytest.mark.parametrize("kind", ["int16", "uint16", "int32", "float32"])
def test_tile_compressed_cubes_are_unpacked(kind: str, tmp_path: Path) -> None:
    values = values_of(kind)
    how = {"compression_type": "GZIP_1", "quantize_level": 0.0} if kind == "float32" else {}
    path = compressed(tmp_path / "cube.fits.fz", values, **how)
    assert_read(path, values)
    np.testing.assert_array_equal(open_volume(str(path)).read(Box((1, 2, 3), (4, 4, 5))), values[3:5, 2:4, 1:4])
    plain = written(tmp_path / "cube.fits", values, SKY, VELOCITY)
    assert described(path).geometry == described(plain).geometry


def test_quantised_tiles_have_the_values_that_astropy_reads(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).normal(size=(8, 30, 40)).astype(np.float32)
    noise[2, 3, 4] = np.nan
    path = compressed(tmp_path / "cube.fits.fz", noise, quantize_level=16)
    expected = fits.getdata(path, 1)
    assert np.isnan(expected[2, 3, 4])
    assert_read(path, expected)


def test_only_the_sub_cube_is_read(tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 1000, (64, 128, 128)).astype(np.int32)
    plain = written(tmp_path / "cube.fits", values, SKY, VELOCITY)
    tiled = compressed(tmp_path / "cube.fits.fz", values, tile_shape=(1, 128, 128))
    box = Box((0, 32, 40), (128, 96, 44))
    for path, share in ((plain, 1.0), (tiled, 1.0)):
        read_whole(path)  # imports what the format needs
        before = bytes_read()
        reader = open_volume(str(path))
        opened = bytes_read() - before
        assert reader.description.reads_sub_cubes
        assert opened < 32 * 2880
        before = bytes_read()
        np.testing.assert_array_equal(reader.read(box), values[40:44, 32:96])
        assert bytes_read() - before < share * 4 * box.voxels + 48 * 2880


def test_tiles_that_are_cut_off_after_the_file_was_opened_are_one_clear_line(tmp_path: Path) -> None:
    """Were the file mapped, this process would end by SIGBUS."""
    path = compressed(tmp_path / "cube.fits.fz", np.random.default_rng(0).integers(0, 1000, (64, 64, 64), np.int32))
    reader = open_volume(str(path))
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 2)
    with pytest.raises(BadInput, match="cube.fits.fz: .*truncated"):
        reader.read(reader.description.geometry.box)


def test_reading_is_silent(shared_data: Path, capfd: pytest.CaptureFixture[str]) -> None:
    read_whole(shared_data / NGC_6946)  # its header needs six corrections
    assert capfd.readouterr() == ("", "")


def patched(path: Path, old: str, new: str) -> Path:
    """The header card `old` written over; both are the start of a card."""
    raw = path.read_bytes()
    assert raw.count(old.encode()) == 1
    start = raw.index(old.encode())
    path.write_bytes(raw[:start] + new.ljust(80).encode() + raw[start + 80 :])
    return path


def cut(path: Path, count: int) -> Path:
    path.write_bytes(path.read_bytes()[:-count])
    return path


def zipped_and_cut(folder: Path, share: float) -> Path:
    noise = np.random.default_rng(0).normal(size=(20, 30, 40))
    packed = gzip.compress(written(folder / "cube.fits", noise).read_bytes())
    path = folder / "cube.fits.gz"
    path.write_bytes(packed[: int(len(packed) * share)])
    return path


def plain(folder: Path, *headers: Header) -> Path:
    return written(folder / "cube.fits", values_of(), SKY, VELOCITY, *headers)


def image(folder: Path, shape: tuple[int, ...], *headers: Header) -> Path:
    return written(folder / "cube.fits", np.zeros(shape, np.int16), *headers)


def table(folder: Path) -> Path:
    hdu = fits.BinTableHDU.from_columns([fits.Column("a", "E", array=[1.0])])
    fits.HDUList([fits.PrimaryHDU(), hdu]).writeto(folder / "cube.fits")
    return folder / "cube.fits"


def tiles(folder: Path) -> Path:
    return compressed(folder / "cube.fits", values_of("int16", (50, 60, 70)))


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "an image": (lambda d: image(d, (6, 7)), "a 2-D image, volsplat needs a volume: its size is 7 x 6"),
    "an image with degenerate axes": (lambda d: image(d, (1, 1, 6, 7)), "a 2-D image"),
    "a spectrum": (lambda d: image(d, (1, 1, 7)), "a 1-D list"),
    "one pixel": (lambda d: image(d, (1, 1, 1)), "holds no image"),
    "a table alone": (table, "holds no image, only headers and tables"),
    "images of four polarisations": (lambda d: image(d, (4, 6, 7), {"CTYPE3": "STOKES"}), "4 values of STOKES a pixel"),
    "colour": (lambda d: image(d, (3, 6, 7), {"CTYPE3": "RGB"}), "3 values of RGB a pixel"),
    "complex numbers": (lambda d: image(d, (5, 6, 7, 2), {"CTYPE1": "COMPLEX"}), "choose a plane of axis 1"),
    "no values": (lambda d: patched(plain(d, {"BSCALE": 1}), "BSCALE", "BSCALE  = 0"), "BSCALE of 0"),
    "a scale that is no number": (
        lambda d: patched(plain(d, {"BSCALE": 1}), "BSCALE", "BSCALE  = 'one'"),
        "a damaged or truncated FITS file",
    ),
    "truncated": (lambda d: cut(plain(d), 2880), "promises 840 bytes of voxels, but the file holds only 0"),
    "cut in its header": (lambda d: cut(plain(d), 2 * 2880 - 100), "a damaged or truncated FITS file"),
    "a lying size": (
        lambda d: patched(plain(d), "NAXIS3", "NAXIS3  = 500000000"),
        "promises 84000000000 bytes of voxels",
    ),
    "a size below zero": (lambda d: patched(plain(d), "NAXIS3", "NAXIS3  = -5"), "cube.fits"),
    "a size missing": (lambda d: patched(plain(d), "NAXIS3", "COMMENT"), "a damaged or truncated FITS file"),
    "an unknown type": (lambda d: patched(plain(d), "BITPIX", "BITPIX  = 12"), "a damaged or truncated FITS file"),
    "truncated gzip": (lambda d: zipped_and_cut(d, 0.7), "truncated"),
    "gzip that ends in the header": (lambda d: zipped_and_cut(d, 0.001), "truncated"),
    "truncated tiles": (lambda d: cut(tiles(d), 2880 * 30), "is truncated, it ends before its tiles do"),
    "a lying size of tiles": (lambda d: patched(tiles(d), "ZNAXIS3", "ZNAXIS3 = 50000"), "need 3000000 tiles"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_files_are_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    assert_refused_in_one_line(read_whole, make(tmp_path), cause, capfd)


def test_a_plane_of_interleaved_numbers_is_refused(tmp_path: Path) -> None:
    path = image(tmp_path, (5, 6, 7, 2), {"CTYPE1": "COMPLEX"})
    with pytest.raises(BadInput, match="axis 1 lies between the pixels of a plane"):
        open_volume(f"{path}#axis1=0")


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("damaged")
    return [plain(folder), compressed(folder / "tiled.fits", values_of("int16"))]


@pytest.mark.parametrize("which", [0, 1])
@given(data=st.data())
def test_a_damaged_header_is_read_or_refused(which: int, data: st.DataObject, originals: list[Path]) -> None:
    raw = bytearray(originals[which].read_bytes())
    end = len(raw) - 2880 * (1 + which)
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(30, end - 1))] = data.draw(st.integers(32, 126))
    damaged = originals[which].with_name(f"damaged_{which}.fits")
    damaged.write_bytes(raw)
    try:
        reader = open_volume(str(damaged))
        box = reader.description.geometry.box
        if math.prod(box.high) <= 8 * math.prod(SHAPE):
            assert reader.read(box).shape == box.high[::-1]
    except BadInput as refusal:
        assert "\n" not in str(refusal)
