"""SEG-Y surveys: the traces that segyio reads, upright and in place, and what is refused."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import segyio
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole
from support.files.prepared import prepare_small
from support.files.refusals import assert_refused_in_one_line
from volsplat.mapshade_server.held.packet_store import attributes_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, VolumeDescription
from volsplat.protocol.geometry.matrices import Vector, column, determinant
from volsplat.protocol.text.errors import BadInput

INLINES, CROSSLINES, SAMPLES = range(10, 15), range(300, 312, 2), 20
F3 = "seismic/f3.sgy"
SAME_AS_F3 = ("f3-lsb.sgy", "Format1msb.sgy", "Format5lsb.sgy")

Place = tuple[int, int]  # inline, crossline
Header = dict[int, int]


def amplitude(inline: int, crossline: int) -> Voxels:
    """A trace that says where it belongs, small enough for each sample format."""
    return (inline - 12) * 9 + (crossline - 305) + np.arange(SAMPLES, dtype=np.float32)


def on_map(inline: int, crossline: int) -> Header:
    """Bins of 25 m along crosslines and 12.5 m along inlines, in decimetres, the inlines to the north."""
    return {71: -10, 181: 4_000_000 + 125 * (crossline - 300), 185: 60_000_000 + 125 * (inline - 10)}


def by_inline() -> list[Place]:
    return [(inline, crossline) for inline in INLINES for crossline in CROSSLINES]


def written(
    path: Path,
    places: Sequence[Place],
    sample_format: int = 5,
    endian: str = "big",
    headers: Callable[[int, int], Header] = on_map,
    binary: Header | None = None,
    bytes_of_numbers: tuple[int, int] = (189, 193),
    samples: int = SAMPLES,
) -> Path:
    spec = segyio.spec()
    spec.samples = np.arange(samples) * 4.0
    spec.format, spec.endian, spec.tracecount = sample_format, endian, len(places)
    with segyio.create(path, spec) as file:
        for n, (inline, crossline) in enumerate(places):
            numbers = dict(zip(bytes_of_numbers, (inline, crossline), strict=True))
            file.header[n] = {**numbers, **headers(inline, crossline)}
            file.trace[n] = np.resize(amplitude(inline, crossline), samples).astype(file.dtype)
        file.bin.update({3217: 4000, 3255: 1, **(binary or {})})
    return path


def expected(places: Sequence[Place]) -> Voxels:
    """The voxels of the grid of INLINES and CROSSLINES, NaN where no trace is."""
    voxels = np.full((len(INLINES), len(CROSSLINES), SAMPLES), np.nan, np.float32)
    for inline, crossline in places:
        voxels[INLINES.index(inline), CROSSLINES.index(crossline)] = amplitude(inline, crossline)
    return voxels


def step(description: VolumeDescription, axis: int) -> Vector:
    return column(description.geometry.index_to_physical, axis)


def axes_told(description: VolumeDescription) -> list[tuple[str, str, float, float]]:
    return [(axis.name, axis.unit, axis.first, axis.step) for axis in description.axes or ()]


@pytest.mark.parametrize("name", ["f3.sgy", "f3-lsb.sgy", "Format1msb.sgy", "Format5lsb.sgy", "Format8msb.sgy"])
def test_a_real_survey_has_the_traces_that_segyio_reads(name: str, shared_data: Path) -> None:
    path = shared_data / "seismic" / name
    with segyio.open(path, endian="little" if "lsb" in name else "big") as file:
        cube = segyio.tools.cube(file)
    got = read_whole(path)
    assert got.dtype == cube.dtype and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_array_equal(got, cube)
    assert described(path).geometry.dims == (75, 18, 23)
    np.testing.assert_array_equal(open_volume(str(path)).read(Box((5, 3, 7), (31, 17, 20))), cube[7:20, 3:17, 5:31])


def test_the_f3_survey_is_the_same_in_every_format(shared_data: Path) -> None:
    voxels = read_whole(shared_data / F3)
    assert (voxels.min(), voxels.max()) == (-10239, 10827)
    for name in SAME_AS_F3:
        np.testing.assert_allclose(read_whole(shared_data / "seismic" / name), voxels, atol=0.5)  # rounded to integers
        assert described(shared_data / "seismic" / name).geometry == described(shared_data / F3).geometry


def test_the_f3_survey_is_placed_by_its_coordinates(shared_data: Path) -> None:
    description = described(shared_data / F3)
    assert axes_told(description) == [
        ("time", "ms", 4.0, 4.0),
        ("crossline", "", 875.0, 1.0),
        ("inline", "", 111.0, 1.0),
    ]
    assert (description.unit, description.value_unit, description.density_name) == ("m", "", "amplitude")
    assert description.geometry.spacing == pytest.approx((4, 25, 25), rel=tolerances.GEOMETRY_PRINTED)
    down, along, across = (step(description, axis) for axis in range(3))
    assert down == (0, 0, -4) and description.geometry.origin == (0, 0, -4)
    assert along[0] > 0 and along[1:] == (0, 0)
    assert across[1] > 0 and across[2] == 0  # inlines grow to the north, crosslines to the east
    velocity, turn = description.warnings
    assert "velocity of 2000 m/s, 1 m for each ms" in velocity
    # From the first crossline to the last the coordinates grow by 424.9 m to the east and 11.8 m to the north.
    assert f"towards azimuth {math.degrees(math.atan2(4249, 118)):.1f} degrees" in turn


def test_the_small_file_follows_its_formula(shared_data: Path) -> None:
    path = shared_data / "seismic" / "small.sgy"
    voxels = read_whole(path)
    k, j, i = np.meshgrid(range(5), range(5), range(50), indexing="ij")
    np.testing.assert_allclose(voxels, (1 + k) + (20 + j) / 100 + i / 100000, rtol=tolerances.IBM_FLOAT)
    description = described(path)
    assert axes_told(description)[1:] == [("crossline", "", 20.0, 1.0), ("inline", "", 1.0, 1.0)]
    assert description.unit == "" and description.geometry.spacing == (1, 1, 1)
    assert step(description, 0) == (0, 0, -1)
    assert "drawn as cubes" in description.warnings[0]


@pytest.mark.parametrize("endian", ["big", "little"])
@pytest.mark.parametrize(
    ("sample_format", "scalar_type"),
    [(1, "float32"), (2, "int32"), (3, "int16"), (5, "float32"), (6, "float64"), (8, "int8"), (9, "int64")],
)
def test_sample_formats_in_both_byte_orders(sample_format: int, scalar_type: str, endian: str, tmp_path: Path) -> None:
    path = written(tmp_path / "survey.segy", by_inline(), sample_format, endian)
    assert described(path).scalar_type == scalar_type == read_whole(path).dtype.name
    assert endian in described(path).format
    np.testing.assert_array_equal(read_whole(path), expected(by_inline()))


@pytest.mark.parametrize("blank", [b" ", b"\x40", b"\0", b"\n"], ids=["ASCII", "EBCDIC", "zeros", "lines"])
def test_a_textual_header_may_be_blank(blank: bytes, tmp_path: Path) -> None:
    path = written(tmp_path / "survey.segy", by_inline())
    path.write_bytes(3200 * blank + path.read_bytes()[3200:])
    np.testing.assert_array_equal(read_whole(path), expected(by_inline()))


ORDERS: dict[str, Callable[[], list[Place]]] = {
    "by inline": by_inline,
    "by crossline": lambda: sorted(by_inline(), key=lambda place: place[::-1]),
    "inlines downwards": lambda: sorted(by_inline(), key=lambda place: (-place[0], place[1])),
    "crosslines downwards": lambda: sorted(by_inline(), key=lambda place: (place[0], -place[1])),
    "shuffled": lambda: [by_inline()[n] for n in np.random.default_rng(0).permutation(len(by_inline()))],
}


@pytest.mark.parametrize("order", ORDERS)
def test_traces_are_put_where_their_numbers_say(order: str, tmp_path: Path) -> None:
    path = written(tmp_path / "survey.sgy", ORDERS[order](), sample_format=3)
    voxels = expected(by_inline())
    assert described(path).geometry == described(written(tmp_path / "plain.sgy", by_inline())).geometry
    got = read_whole(path)
    assert got.dtype == np.int16
    np.testing.assert_array_equal(got, voxels)
    np.testing.assert_array_equal(open_volume(str(path)).read(Box((3, 1, 2), (9, 5, 4))), voxels[2:4, 1:5, 3:9])


IRREGULAR = {
    "cut corners": [place for place in by_inline() if place not in ((10, 300), (10, 302), (14, 310))],
    "a hole": [place for place in by_inline() if place != (12, 304)],
    "a line missing": [place for place in by_inline() if place[0] != 12],
    "a sheared outline": [place for place in by_inline() if 280 <= place[1] - 2 * place[0] < 288],
    "an unfinished last line": by_inline()[:-2],
}  # fmt: skip


@pytest.mark.parametrize("case", IRREGULAR)
@pytest.mark.parametrize("sample_format", [1, 3])
def test_missing_traces_hold_no_data(case: str, sample_format: int, tmp_path: Path) -> None:
    places = IRREGULAR[case]
    path = written(tmp_path / "survey.sgy", places, sample_format)
    description = described(path)
    got = read_whole(path)
    assert got.dtype == np.float32 and description.scalar_type == "float32"
    np.testing.assert_array_equal(got, expected(places))
    np.testing.assert_array_equal(open_volume(str(path)).read(Box((3, 0, 0), (9, 3, 3))), expected(places)[:3, :3, 3:9])
    assert f"{30 - len(places)} of 30 traces of the grid are not in the file" in description.warnings[-1]
    assert description.geometry.spacing == pytest.approx((4, 25, 12.5))


def turned(degrees: float, mirrored: bool = False) -> Callable[[int, int], Header]:
    """Crosslines 20 m apart to an azimuth, inlines 30 m apart a right angle to their left, or to their right."""
    angle = math.radians(degrees)
    side = -1 if mirrored else 1

    def headers(inline: int, crossline: int) -> Header:
        x, y = 20 * (crossline - 300) / 2, side * 30 * (inline - 10)
        east, north = x * math.sin(angle) - y * math.cos(angle), x * math.cos(angle) + y * math.sin(angle)
        return {71: -100, 181: round(100 * (5000 + east)), 185: round(100 * (7000 + north))}

    return headers


@pytest.mark.parametrize("azimuth", [0.0, 37.0, 90.0, 200.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_turned_survey_keeps_its_distances_and_its_handedness(azimuth: float, mirrored: bool, tmp_path: Path) -> None:
    path = written(tmp_path / "survey.sgy", by_inline(), headers=turned(azimuth, mirrored))
    description = described(path)
    assert step(description, 1) == pytest.approx((20, 0, 0), rel=tolerances.GEOMETRY_PRINTED)
    assert step(description, 2) == pytest.approx((0, -30 if mirrored else 30, 0), rel=tolerances.GEOMETRY_PRINTED)
    assert (determinant(description.geometry.index_to_physical) > 0) == mirrored  # samples count downwards
    notes = [note for note in description.warnings if "azimuth" in note]
    assert notes == [] if azimuth == 90 else f"towards azimuth {azimuth:.1f} degrees" in notes[0]


def test_lines_that_cross_at_an_angle_stay_skewed(tmp_path: Path) -> None:
    def headers(inline: int, crossline: int) -> Header:
        x = 10 * (crossline - 300) + 8 * (inline - 10)
        return {181: x, 185: 15 * (inline - 10)}

    description = described(written(tmp_path / "survey.sgy", by_inline(), headers=headers))
    assert step(description, 1) == pytest.approx((20, 0, 0))
    assert step(description, 2) == pytest.approx((8, 15, 0))


def test_older_files_have_their_coordinates_in_the_source_fields(tmp_path: Path) -> None:
    def headers(inline: int, crossline: int) -> Header:
        there = on_map(inline, crossline)
        return {71: there[71], 73: there[181], 77: there[185]}

    path = written(tmp_path / "survey.sgy", by_inline(), headers=headers)
    assert described(path).geometry == described(written(tmp_path / "plain.sgy", by_inline())).geometry


def test_dead_traces_at_0_0_leave_the_others_where_they_are(tmp_path: Path) -> None:
    def headers(inline: int, crossline: int) -> Header:
        dead = (inline, crossline) in (by_inline()[0], by_inline()[-1])
        return {71: -10, 181: 0, 185: 0} if dead else on_map(inline, crossline)

    path = written(tmp_path / "survey.sgy", by_inline(), headers=headers)
    whole = described(written(tmp_path / "plain.sgy", by_inline())).geometry
    np.testing.assert_allclose(described(path).geometry.index_to_physical, whole.index_to_physical, rtol=1e-9)
    assert "2 of 30 traces looked at have no coordinates" in described(path).warnings[-1]


def test_feet_stay_feet(tmp_path: Path) -> None:
    description = described(written(tmp_path / "survey.sgy", by_inline(), binary={3255: 2}))
    assert description.unit == "ft"
    assert description.geometry.spacing == pytest.approx((4 / 0.3048, 25, 12.5))


UNPLACED: dict[str, Callable[[int, int], Header]] = {
    "no coordinates": lambda inline, crossline: {},
    "one place": lambda inline, crossline: {181: 7, 185: 8},
    "scattered": lambda inline, crossline: {181: inline * crossline % 97, 185: inline * crossline % 89},
    "degrees": lambda inline, crossline: {**on_map(inline, crossline), 89: 2},
}  # fmt: skip


@pytest.mark.parametrize("case", UNPLACED)
def test_without_a_map_voxels_are_cubes_and_this_is_told(case: str, tmp_path: Path) -> None:
    description = described(written(tmp_path / "survey.sgy", by_inline(), headers=UNPLACED[case]))
    assert description.unit == "" and description.geometry.spacing == (1, 1, 1)
    assert "drawn as cubes" in description.warnings[0]
    assert "whatever the velocity" in described(f"{tmp_path / 'survey.sgy'}#velocity=3000").warnings[0]


def test_depth_needs_no_velocity_and_time_may_have_another(tmp_path: Path) -> None:
    path = written(tmp_path / "survey.sgy", by_inline(), headers=lambda il, xl: {**on_map(il, xl), 109: 100})
    deep = described(f"{path}#domain=depth")
    assert axes_told(deep)[0] == ("depth", "m", 100.0, 4.0) and deep.warnings == ()
    assert step(deep, 0) == (0, 0, -4) and deep.geometry.origin == (0, 0, -100)
    fast = described(f"{path}#velocity=3000")
    assert axes_told(fast)[0] == ("time", "ms", 100.0, 4.0)
    assert step(fast, 0) == (0, 0, -6) and fast.geometry.origin == (0, 0, -150)
    assert "velocity of 3000 m/s, 1.5 m for each ms" in fast.warnings[0]


def test_a_store_says_to_prepare_it_anew_with_another_velocity(tmp_path: Path) -> None:
    path = written(tmp_path / "survey.sgy", by_inline())
    prepare_small(path, tmp_path / "survey.zarr")
    (note,) = attributes_of(tmp_path / "survey.zarr").description.warnings
    assert note.endswith("another as in survey.sgy#velocity=3000; for the store prepare it anew from that")


def test_numbers_may_lie_elsewhere_in_the_header(tmp_path: Path) -> None:
    path = written(tmp_path / "survey.sgy", by_inline(), bytes_of_numbers=(9, 21))
    np.testing.assert_array_equal(read_whole(f"{path}#il=9,xl=21"), expected(by_inline()))
    with pytest.raises(BadInput, match=r"bytes 9 and 21 look like a grid's: give .*survey.sgy#il=9,xl=21"):
        open_volume(str(path))


@pytest.mark.parametrize(
    ("part", "cause"),
    [
        ("il=10", "no byte where a field of the trace header starts"),
        ("xl=x", "no byte where a field of the trace header starts"),
        ("domain=space", "neither time nor depth"),
        ("velocity=0", "no velocity in m/s"),
        ("velocity=fast", "no velocity in m/s"),
        ("domain=depth,velocity=2000", "no velocity in m/s that turns time into depth"),
        ("bright", "no part “bright”"),
    ],
)
def test_parts_that_make_no_sense_are_refused(part: str, cause: str, tmp_path: Path) -> None:
    path = written(tmp_path / "survey.sgy", by_inline())
    with pytest.raises(BadInput, match=cause):
        open_volume(f"{path}#{part}")


def test_intervals_that_disagree_are_told(tmp_path: Path) -> None:
    path = written(tmp_path / "survey.sgy", by_inline(), headers=lambda il, xl: {**on_map(il, xl), 117: 2000})
    description = described(path)
    assert axes_told(description)[0][3] == 4.0
    assert "4000 µs is used, the first trace says 2000 µs" in description.warnings[-1]


def large(path: Path, places: Sequence[Place]) -> Path:
    return written(path, places, samples=1500)


def test_only_the_traces_of_the_sub_cube_are_read(tmp_path: Path) -> None:
    places = [(inline, crossline) for inline in range(40) for crossline in range(50)]
    path = large(tmp_path / "survey.sgy", places)
    read_whole(path)  # imports what the format needs
    size = path.stat().st_size
    before = bytes_read()
    reader = open_volume(str(path))
    assert reader.description.reads_sub_cubes
    assert bytes_read() - before < size / 8  # some hundred headers
    for box in (Box((0, 10, 30), (1500, 20, 34)), Box((500, 10, 30), (1000, 20, 34))):
        before = bytes_read()
        reader.read(box)
        traces = box.size[1] * box.size[2]
        # A page or two around each header and trace, and what opening the file takes.
        assert bytes_read() - before < 4 * box.voxels + (traces + 4) * 3 * 4096
    before = bytes_read()
    large(tmp_path / "irregular.sgy", places[:-1])
    reader = open_volume(str(tmp_path / "irregular.sgy"))
    before = bytes_read()
    reader.read(Box((500, 10, 30), (1000, 20, 34)))
    assert bytes_read() - before < 4 * 500 * 40 + 44 * 3 * 4096


def damaged(path: Path, offset: int, new: bytes) -> Path:
    raw = bytearray(path.read_bytes())
    raw[offset : offset + len(new)] = new
    path.write_bytes(raw)
    return path


def cut(path: Path, count: int) -> Path:
    path.write_bytes(path.read_bytes()[:-count])
    return path


def plain(folder: Path, **how: Any) -> Path:
    return written(folder / "survey.sgy", by_inline(), **how)


def later_crosslines(inline: int, crossline: int) -> Header:
    return {**on_map(inline, crossline), 109: 4 * (crossline > 304)}


def gathers() -> list[Place]:
    return [place for place in by_inline() for _ in range(3)]


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "a 2-D line": (lambda d: written(d / "line.sgy", [(0, n) for n in range(30)]), "a 2-D line, volsplat needs"),
    "one inline": (lambda d: written(d / "line.sgy", by_inline()[:6]), "a 2-D line, volsplat needs a volume"),
    "a crooked line": (
        lambda d: written(d / "line.sgy", [(n, 3 * n) for n in range(100)]),
        "100 traces are too few for the grid of 100 x 100",
    ),
    "no numbers": (
        lambda d: written(d / "survey.sgy", [(0, 0)] * 30),
        "its 30 traces have no numbers that differ for inlines (byte 189) and crosslines (byte 193)",
    ),
    "pre-stack gathers": (
        lambda d: written(d / "gathers.sgy", gathers()),
        "has 3 traces on average at one inline and crossline: pre-stack gathers",
    ),
    "one trace doubled": (
        lambda d: written(d / "survey.sgy", [*by_inline(), (14, 310)]),
        "its 31 traces lie at 30 places, as 29 and 30 both at inline 14 and crossline 310; remove copies",
    ),
    "one doubled, one missing": (
        lambda d: written(d / "survey.sgy", [(12, 306) if place == (12, 304) else place for place in by_inline()]),
        "trace 14 says crossline 306 where the order of the others lets expect 304",
    ),
    "a number gone wild": (
        lambda d: damaged(plain(d), 3600 + 6 * (240 + 80) + 188, b"\x7f\xff\xff\xff"),
        "traces are too few for the grid",
    ),
    "several start times": (lambda d: plain(d, headers=later_crosslines), "begin at different times, 0 to 4 ms"),
    "no interval": (lambda d: plain(d, binary={3217: 0}), "a sample interval of 0"),
    "no samples": (lambda d: damaged(plain(d), 3220, b"\0\0"), "traces of no samples"),
    "more samples than there are": (lambda d: damaged(plain(d), 3220, b"\x75\x30"), "cannot be read"),
    "truncated": (lambda d: cut(plain(d), 100), "it is truncated"),
    "headers alone": (lambda d: cut(plain(d), 30 * (240 + 80)), "is too short"),
    "a text": (lambda d: damaged(plain(d), 3224, b"ab"), "states no format of samples"),
    "an old format": (lambda d: damaged(plain(d), 3224, b"\0\4"), "fixed point with gain (format 4)"),
    "an unused format": (lambda d: damaged(plain(d), 3224, b"\0\x0d"), "states no format of samples"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_files_are_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    assert_refused_in_one_line(read_whole, make(tmp_path), cause, capfd)


def test_gathers_told_apart_by_their_offsets_are_refused(tmp_path: Path) -> None:
    """The way that segyio itself knows pre-stack files."""
    spec = segyio.spec()
    spec.ilines, spec.xlines, spec.offsets = [1, 2, 3], [4, 5, 6], [100, 200]
    spec.samples, spec.format, spec.sorting = np.arange(9) * 4.0, 5, 2
    with segyio.create(tmp_path / "gathers.sgy", spec) as file:
        for n in range(18):
            file.header[n] = {189: 1 + n // 6, 193: 4 + n // 2 % 3, 37: 100 + n % 2 * 100}
            file.trace[n] = np.zeros(9, np.float32)
    with pytest.raises(BadInput, match="has 2 traces at one inline and crossline: pre-stack gathers"):
        open_volume(str(tmp_path / "gathers.sgy"))


def test_reading_is_silent(shared_data: Path, capfd: pytest.CaptureFixture[str]) -> None:
    read_whole(shared_data / F3)
    assert capfd.readouterr() == ("", "")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    yield plain(tmp_path_factory.mktemp("damaged"))


@given(data=st.data())
def test_damaged_headers_are_read_or_refused(data: st.DataObject, original: Path) -> None:
    raw = bytearray(original.read_bytes())
    trace = 240 + 4 * SAMPLES
    for _ in range(data.draw(st.integers(1, 4))):
        n = data.draw(st.integers(-1, 29))
        start, count = (3200, 400) if n < 0 else (3600 + n * trace, 240)
        raw[start + data.draw(st.integers(0, count - 1))] = data.draw(st.integers(0, 255))
    path = original.with_name("damaged.sgy")
    path.write_bytes(raw)
    try:
        reader = open_volume(str(path))
        box = reader.description.geometry.box
        assert reader.read(box).shape == box.high[::-1]
    except BadInput as refusal:
        assert "\n" not in str(refusal)
