"""CCP4 and MRC maps: values and places are gemmi's, only the wanted rows are read, and what is odd is told."""

import gzip
import math
import struct
from collections.abc import Callable
from itertools import permutations
from pathlib import Path
from typing import Any, Literal

import gemmi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.map_files import CELL, MODES, map_file, map_header, map_values
from support.files.opened import read_whole, refused
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.text.errors import BadInput

DIMS = (7, 6, 5)
REAL = {  # dimensions, spacing, origin, least and greatest value
    "EMD-3197.map": ((20, 20, 20), (11.4, 11.4, 11.4), (-22.8, 0, 0), (-4.1337, 5.5767)),
    "EMD-3001.map": ((73, 43, 25), (0.45875, 0.44825, 0.3925), (-9.41325, -4.71, 0), (-0.3681, 0.7216)),
    "3ek3-2fofc.map.gz": ((100, 92, 123), (0.58146, 0.56403, 0.57113), (-28.2014, -0.58146, -10.2803), (-0.965, 7.998)),
}


def geometry_of(path: Path) -> Geometry:
    return open_volume(str(path)).description.geometry


@pytest.mark.parametrize("name", REAL)
def test_a_real_map_is_as_its_table_says(name: str, shared_data: Path, capfd: pytest.CaptureFixture[str]) -> None:
    dims, spacing, origin, limits = REAL[name]
    description = open_volume(str(shared_data / "maps" / name)).description
    assert description.geometry.dims == dims
    assert description.geometry.spacing == pytest.approx(spacing, rel=tolerances.GEOMETRY_PRINTED)
    assert description.geometry.origin == pytest.approx(origin, rel=tolerances.GEOMETRY_PRINTED)
    assert (description.scalar_type, description.unit, description.warnings) == ("float32", "Å", ())
    assert not description.anatomical
    assert description.reads_sub_cubes == (not name.endswith(".gz"))
    voxels = read_whole(shared_data / "maps" / name)
    assert (float(voxels.min()), float(voxels.max())) == pytest.approx(limits, rel=tolerances.RANGE_PRINTED)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", REAL)
def test_a_real_map_has_at_each_place_what_gemmi_has(name: str, shared_data: Path) -> None:
    path = shared_data / "maps" / name
    whole_cell = gemmi.read_ccp4_map(str(path))
    whole_cell.setup(math.nan)
    reader = open_volume(str(path))
    geometry, voxels = reader.description.geometry, reader.read(reader.description.geometry.box)
    generator = np.random.default_rng(0)
    for _ in range(200):
        i, j, k = (int(generator.integers(size)) for size in geometry.dims)
        place = gemmi.Position(*geometry.physical((float(i), float(j), float(k))))
        expected = whole_cell.grid.interpolate_value(place)
        assert voxels[k, j, i] == pytest.approx(expected, rel=tolerances.RANGE_PRINTED, abs=tolerances.RANGE_PRINTED)


def test_a_model_lies_in_its_map(shared_data: Path) -> None:
    reader = open_volume(str(shared_data / "maps/3ek3-2fofc.map.gz"))
    geometry = reader.description.geometry
    voxels = reader.read(geometry.box)
    model = gemmi.read_structure(str(shared_data / "maps/3ek3.cif"))[0]
    to_index = matrices.inverse(geometry.index_to_physical)
    protein = []
    for residue in (residue for chain in model for residue in chain if not residue.is_water()):
        for atom in residue:
            offset = matrices.minus((atom.pos.x, atom.pos.y, atom.pos.z), geometry.origin)
            index = tuple(round(x) for x in matrices.applied(to_index, offset))
            assert all(0 <= n < size for n, size in zip(index, geometry.dims, strict=True))
            protein.append(float(voxels[index[::-1]]))
    # The map is in its standard deviations: solvent is about 0, and a model's atoms are at peaks of 1 and more.
    assert np.median(protein) > np.percentile(voxels, 97)
    assert np.mean(np.array(protein) > np.percentile(voxels, 90)) > 0.9


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("scalar_type", MODES)
def test_every_mode_comes_back_in_both_byte_orders(scalar_type: str, order: Literal["<", ">"], tmp_path: Path) -> None:
    values = map_values(scalar_type)
    limits = (0.0, 255.0) if scalar_type == "uint8" else (-4.0, 4.0)
    header = map_header(DIMS, order, mode=MODES[scalar_type], limits=limits)
    path = map_file(tmp_path / "volume.mrc", values.astype(values.dtype.newbyteorder(order)), header)
    description = open_volume(str(path)).description
    got = read_whole(path)
    assert got.dtype.name == description.scalar_type == ("float32" if scalar_type == "float16" else scalar_type)
    assert got.dtype.isnative and got.flags.c_contiguous and not description.warnings
    np.testing.assert_array_equal(got, values)


@pytest.mark.parametrize(("flags", "scalar_type"), [(0, "uint8"), (1, "int8")])
def test_imod_says_whether_bytes_have_a_sign(flags: int, scalar_type: str, tmp_path: Path) -> None:
    values = map_values(scalar_type)
    header = map_header(DIMS, mode=0, limits=(0.0, 90.0), imod=(1146047817, flags))
    path = map_file(tmp_path / "volume.rec.mrc", values, header)
    assert open_volume(str(path)).description.scalar_type == scalar_type


@pytest.mark.parametrize("axes", list(permutations((1, 2, 3))))
def test_voxels_lie_where_gemmi_has_them_in_any_axis_order(axes: tuple[int, int, int], tmp_path: Path) -> None:
    header = map_header(DIMS, axes=axes, starts=(-3, 2, 11))
    path = map_file(tmp_path / "volume.map", map_values("float32"), header)
    geometry = geometry_of(path)
    cell = gemmi.UnitCell(*CELL)
    for index in ((0, 0, 0), (6, 0, 0), (0, 5, 0), (0, 0, 4), (3, 2, 1)):
        along = dict(zip(axes, (start + n for start, n in zip((-3, 2, 11), index, strict=True)), strict=True))
        expected = cell.orthogonalize(gemmi.Fractional(along[1] / 20, along[2] / 24, along[3] / 50)).tolist()
        place = geometry.physical((float(index[0]), float(index[1]), float(index[2])))
        assert place == pytest.approx(expected, rel=tolerances.GEOMETRY_FLOAT64, abs=tolerances.GEOMETRY_FLOAT64)
    handed = matrices.determinant(geometry.index_to_physical)
    assert (handed > 0) == (axes in ((1, 2, 3), (2, 3, 1), (3, 1, 2)))


def test_gemmi_writes_what_is_read(tmp_path: Path) -> None:
    values = map_values("float32", (12, 10, 8))
    written = gemmi.Ccp4Map()
    written.grid = gemmi.FloatGrid(np.asfortranarray(values.T), gemmi.UnitCell(*CELL), gemmi.SpaceGroup("P 1"))
    written.update_ccp4_header()
    written.write_ccp4_map(str(tmp_path / "gemmi.ccp4"))
    np.testing.assert_array_equal(read_whole(tmp_path / "gemmi.ccp4"), values)
    cell = gemmi.UnitCell(*CELL)
    corner = geometry_of(tmp_path / "gemmi.ccp4").physical((12.0, 10.0, 8.0))
    assert corner == pytest.approx(
        cell.orthogonalize(gemmi.Fractional(1, 1, 1)).tolist(), rel=tolerances.GEOMETRY_FLOAT32
    )


def test_the_origin_words_place_the_map(tmp_path: Path) -> None:
    values = map_values("float32")
    header = map_header(DIMS, origin=(5.0, -6.0, 7.5))
    description = open_volume(str(map_file(tmp_path / "volume.mrc", values, header))).description
    assert description.geometry.origin == (5.0, -6.0, 7.5) and not description.warnings
    header = map_header(DIMS, origin=(5.0, -6.0, 7.5), starts=(1, 2, 3))
    description = open_volume(str(map_file(tmp_path / "volume.mrc", values, header))).description
    assert description.geometry.origin == (5.0, -6.0, 7.5)
    assert "places the map twice" in description.warnings[0]


def test_an_origin_that_repeats_the_start_is_not_added_to_it(tmp_path: Path) -> None:
    cell = (20.0, 48.0, 100.0, 90.0, 90.0, 90.0)
    header = map_header(DIMS, cell=cell, origin=(4.0, -6.0, 16.0), starts=(4, -3, 8))
    description = open_volume(str(map_file(tmp_path / "volume.mrc", map_values("float32"), header))).description
    assert description.geometry.origin == pytest.approx((4.0, -6.0, 16.0), rel=tolerances.GEOMETRY_FLOAT32)
    assert not description.warnings


@pytest.mark.parametrize(
    ("words", "warning"),
    [
        ({"cell": [0.0] * 6}, "no cell"),
        ({"cell": [20.0, 24.0, 50.0, 0.0, 0.0, 0.0]}, "90 degrees"),
        ({"intervals": [0, 0, 0]}, "fill"),
        ({"space_group": 0}, "stack of images"),
        ({"stamp": b"\x11\x11\0\0"}, "the other byte order"),
        ({"skewed": 1}, "LSKFLG"),
    ],
)
def test_what_had_to_be_guessed_is_told(words: dict[str, Any], warning: str, tmp_path: Path) -> None:
    values = map_values("float32")
    path = map_file(tmp_path / "volume.mrc", values, map_header(DIMS, **words))
    description = open_volume(str(path)).description
    assert len(description.warnings) == 1 and warning in description.warnings[0]
    np.testing.assert_array_equal(read_whole(path), values)


def test_a_map_without_a_cell_has_no_unit(tmp_path: Path) -> None:
    header = map_header(DIMS, cell=[0.0] * 6, axes=(0, 0, 0), starts=(1, 2, 3))
    description = open_volume(str(map_file(tmp_path / "volume.mrc", map_values("float32"), header))).description
    assert description.unit == "" and description.geometry.spacing == (1, 1, 1)
    assert description.geometry.origin == (1, 2, 3)


def test_a_map_without_sampling_fills_its_cell(tmp_path: Path) -> None:
    header = map_header(DIMS, cell=(14.0, 10.0, 6.0, 90, 90, 90), axes=(2, 3, 1), intervals=(0, 0, 0))
    geometry = geometry_of(map_file(tmp_path / "volume.mrc", map_values("float32"), header))
    assert geometry.spacing == pytest.approx((10 / 7, 6 / 6, 14 / 5), rel=tolerances.GEOMETRY_FLOAT32)


def test_old_maps_without_a_mark_are_known_by_their_extension(tmp_path: Path) -> None:
    values = map_values("float32")
    for order, name in (("<", "old.mrc"), (">", "old.map")):
        header = map_header(DIMS, order, magic=bytes(4), stamp=bytes(4))  # type: ignore[arg-type]
        path = map_file(tmp_path / name, values.astype(values.dtype.newbyteorder(order)), header)  # type: ignore[arg-type]
        np.testing.assert_array_equal(read_whole(path), values)


def test_a_volume_of_a_stack_is_chosen_by_number(tmp_path: Path) -> None:
    values = map_values("int16", (7, 6, 15))
    header = map_header((7, 6, 15), mode=1, space_group=401, intervals=(7, 6, 5))
    path = map_file(tmp_path / "stack.mrcs", values, header)
    with pytest.raises(BadInput, match="a series of 3 volumes, numbered from 0"):
        open_volume(str(path))
    for number in range(3):
        assert f"volume {number} of a stack" in open_volume(f"{path}#{number}").description.format
        np.testing.assert_array_equal(read_whole(f"{path}#{number}"), values[5 * number : 5 * number + 5])


@given(data=st.data())
def test_boxes_are_slices_plain_and_compressed(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("maps")
    values = map_values("int16")
    extended = bytes(range(80)) * 3
    plain = map_file(folder / "plain.map", values, extended=extended)
    packed = folder / "packed.map.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    low = tuple(data.draw(st.integers(0, size - 1)) for size in DIMS)
    high = tuple(data.draw(st.integers(least + 1, size)) for least, size in zip(low, DIMS, strict=True))
    box = Box((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    for path in (plain, packed):
        got = open_volume(str(path)).read(box)
        assert got.flags.c_contiguous
        np.testing.assert_array_equal(got, values[low[2] : high[2], low[1] : high[1], low[0] : high[0]])


def test_only_the_rows_of_a_box_are_read(tmp_path: Path) -> None:
    values = np.zeros((128, 128, 128), np.float32)
    path = map_file(tmp_path / "volume.map", values, extended=bytes(8000))
    open_volume(str(path)).read(Box((0, 0, 0), (1, 1, 1)))  # imports what the format needs
    before = bytes_read()
    reader = open_volume(str(path))
    assert reader.description.reads_sub_cubes
    assert bytes_read() - before < path.stat().st_size // 128
    for box in (Box((0, 0, 64), (128, 128, 72)), Box((0, 32, 64), (128, 96, 72)), Box((64, 32, 64), (96, 96, 72))):
        before = bytes_read()
        reader.read(box)
        wanted = 128 * 4 * box.size[1] * box.size[2]
        assert bytes_read() - before - wanted < values.nbytes // 128


def with_header(folder: Path, values: Voxels | None = None, **words: Any) -> Path:
    sizes = words.pop("sizes", DIMS)
    return map_file(folder / "bad.map", map_values("float32") if values is None else values, map_header(sizes, **words))


def cut(path: Path, size: int) -> Path:
    path.write_bytes(path.read_bytes()[:size])
    return path


def packed_cut(folder: Path) -> Path:
    noise = np.random.default_rng(0).standard_normal((20, 20, 20)).astype(np.float32)
    plain = map_file(folder / "bad.map", noise)
    packed = folder / "bad.map.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes())[:-9000])
    return packed


def packed_bomb(folder: Path) -> Path:
    path = folder / "bomb.map.gz"
    path.write_bytes(gzip.compress(map_header((100000, 100000, 100000)) + bytes(1 << 20)))
    return path


def damaged_head(folder: Path) -> Path:
    path = folder / "bad.map.gz"
    path.write_bytes(gzip.compress(map_header(DIMS))[:40])
    return path


NAN = float("nan")
REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "truncated": (lambda d: cut(with_header(d), 1400), "promises 840 bytes of voxels, but the file holds only 376"),
    "header truncated": (lambda d: cut(with_header(d), 700), "header is truncated"),
    "sizes beyond the file": (lambda d: with_header(d, sizes=(60000, 60000, 60000)), "promises"),
    "compressed sizes beyond the file": (packed_bomb, "promises"),
    "compressed data truncated": (packed_cut, "truncated"),
    "compressed header truncated": (damaged_head, "damaged or truncated"),
    "extended header beyond the file": (lambda d: with_header(d, extended=1 << 30), "holds only 0"),
    "extended header before its start": (lambda d: with_header(d, extended=-80), "extended header (-80)"),
    "no sizes": (lambda d: with_header(d, sizes=(7, 0, 5)), "make no sense in either byte order"),
    "axes twice": (lambda d: with_header(d, axes=(1, 1, 3)), "make no sense in either byte order"),
    "a transform": (lambda d: with_header(d, mode=4), "complex numbers (mode 4)"),
    "colours": (lambda d: with_header(d, mode=16), "three colours"),
    "half bytes": (lambda d: with_header(d, mode=101), "mode 101 are not read"),
    "a micrograph": (lambda d: with_header(d, sizes=(7, 30, 1), space_group=0), "a 2-D image"),
    "no angle": (lambda d: with_header(d, cell=(1, 2, 3, 90, 180, 90)), "cell angles (90 180 90)"),
    "flat cell": (lambda d: with_header(d, cell=(1, 2, 3, 120, 120, 120)), "cell angles (120 120 120)"),
    "impossible cell": (lambda d: with_header(d, cell=(1, 2, 3, 150, 150, 150)), "cell angles (150 150 150)"),
    "zero spacing": (lambda d: with_header(d, cell=(1, 0, 3, 90, 90, 90)), "cell lengths (1 0 3)"),
    "NaN spacing": (lambda d: with_header(d, cell=(1, NAN, 3, 90, 90, 90)), "cell lengths (1 nan 3)"),
    "negative sampling": (lambda d: with_header(d, intervals=(-7, 6, 5)), "sampling of the cell (-7 6 5)"),
    "an uneven stack": (
        lambda d: with_header(d, space_group=401, intervals=(7, 6, 2)),
        "number of sections in a stack of volumes (5 2)",
    ),
    "no map": (lambda d: map_file(d / "notes.map", np.zeros((4, 4, 4), "f4"), b"x" * 1024), "is no CCP4 or MRC map"),
    "a part of one volume": (lambda d: Path(f"{with_header(d)}#2"), "holds one volume"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_maps_are_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    path = make(tmp_path)
    text = refused(path)
    assert cause in text and str(tmp_path) in text
    assert capfd.readouterr() == ("", "")


@given(data=st.data())
def test_a_damaged_header_is_read_or_refused(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = map_file(tmp_path_factory.mktemp("damaged") / "volume.map", map_values("float32"))
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        struct.pack_into("B", raw, data.draw(st.integers(0, 223)), data.draw(st.integers(0, 255)))
    path.write_bytes(raw)
    try:
        read_whole(path)
    except BadInput as refusal:
        assert "\n" not in str(refusal)
