"""Volume readers: what is written comes back, boxes equal slices, and only what is needed is read."""

import bz2
import gzip
import math
import zlib
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import read_whole
from support.files.volume_files import ALL_TYPES, DIMS, SKEWED, TURNED, dicom_series, sheared_nifti, values_of, written
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.stored_voxels import READ_THROUGH_BYTES
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.text.errors import BadInput

PLACED = (".nrrd", ".nhdr", ".mha", ".mhd", ".nii", ".nii.gz")
SHEARED = (".nrrd", ".nhdr", ".mha", ".mhd")


def assert_close(geometry: Geometry, matrix: Matrix, tolerance: float) -> None:
    np.testing.assert_allclose(geometry.index_to_physical, matrix, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("scalar_type", ALL_TYPES)
@pytest.mark.parametrize("extension", PLACED)
def test_every_scalar_type_comes_back_from_every_format(extension: str, scalar_type: str, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    path = written(tmp_path / f"volume{extension}", values)
    got = read_whole(path)
    assert open_volume(str(path)).description.scalar_type == scalar_type
    assert got.dtype == values.dtype and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values)


@pytest.mark.parametrize("scalar_type", ["uint8", "int16", "uint16", "float32"])
def test_tiff_stacks_come_back(scalar_type: str, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    np.testing.assert_array_equal(read_whole(written(tmp_path / "volume.tif", values)), values)


@pytest.mark.parametrize("extension", PLACED)
def test_exchanged_axes_and_origin_come_back(extension: str, tmp_path: Path) -> None:
    path = written(tmp_path / f"volume{extension}", values_of("int16"))
    description = open_volume(str(path)).description
    assert description.anatomical and description.unit == "mm"
    assert_close(description.geometry, TURNED, tolerances.GEOMETRY_FLOAT32)
    assert description.geometry.origin == (10.0, -20.5, 30.25)
    assert description.geometry.dims == DIMS


@pytest.mark.parametrize("extension", SHEARED)
def test_skewed_and_left_handed_axes_come_back(extension: str, tmp_path: Path) -> None:
    path = written(tmp_path / f"volume{extension}", values_of("int16"), SKEWED)
    assert_close(open_volume(str(path)).description.geometry, SKEWED, tolerances.GEOMETRY_FLOAT64)


def test_a_sheared_sform_is_kept(tmp_path: Path) -> None:
    values = values_of("uint16")
    path = sheared_nifti(tmp_path / "volume.nii", values, SKEWED)
    assert_close(open_volume(str(path)).description.geometry, SKEWED, tolerances.GEOMETRY_FLOAT32)
    np.testing.assert_array_equal(read_whole(path), values)


@pytest.mark.parametrize("extension", PLACED)
def test_places_are_those_of_simple_itk(extension: str, tmp_path: Path) -> None:
    path = written(tmp_path / f"volume{extension}", values_of("int16"))
    image = sitk.ReadImage(str(path))
    geometry = open_volume(str(path)).description.geometry
    for index in ((0, 0, 0), (6, 0, 0), (1, 5, 4)):
        place = geometry.physical((float(index[0]), float(index[1]), float(index[2])))
        expected = image.TransformIndexToPhysicalPoint(index)
        assert place == pytest.approx(expected, rel=tolerances.GEOMETRY_FLOAT32)


def test_nrrd_spaces_are_turned_to_lps(tmp_path: Path) -> None:
    values = values_of("uint8")
    for space, signs in (("RAS", (-1, -1, 1)), ("left-anterior-superior", (1, -1, 1)), ("LPS", (1, 1, 1))):
        path = nrrd(
            tmp_path / "volume.nrrd",
            values,
            f"space: {space}\nspace directions: (2,0,0) (0,3,0.5) (0,0,4)\nspace origin: (1,2,3)",
        )
        description = open_volume(str(path)).description
        expected = np.diag(signs) @ np.array([[2, 0, 0], [0, 3, 0], [0, 0.5, 4]])
        assert_close(description.geometry, expected.tolist(), tolerances.GEOMETRY_FLOAT64)
        assert description.geometry.origin == (signs[0] * 1, signs[1] * 2, signs[2] * 3)
        assert description.anatomical


def test_nrrd_spacings_alone_place_nothing_in_a_patient(tmp_path: Path) -> None:
    path = nrrd(tmp_path / "volume.nrrd", values_of("uint8"), 'spacings: 1 2 nan\nunits: "um" "um" "um"')
    description = open_volume(str(path)).description
    assert description.geometry.spacing == (1.0, 2.0, 1.0)
    assert not description.anatomical and description.unit == "µm"


def nrrd(path: Path, values: Voxels, fields: str, encoding: str = "raw", data: bytes | None = None) -> Path:
    head = (
        f"NRRD0004\ntype: {values.dtype.name}\ndimension: {values.ndim}\n"
        f"sizes: {' '.join(str(n) for n in values.shape[::-1])}\nendian: little\nencoding: {encoding}\n"
    )
    head += f"{fields}\n\n" if fields else "\n"
    path.write_bytes(head.encode() + (values.tobytes() if data is None else data))
    return path


def every_storage(folder: Path, values: Voxels) -> list[Path]:
    """The same values in every way of storing that the readers know."""
    paths = [written(folder / f"plain{extension}", values) for extension in (*PLACED, ".tif")]
    raw = values.tobytes()
    paths.append(nrrd(folder / "gzip.nrrd", values, "", "gzip", gzip.compress(raw)))
    paths.append(nrrd(folder / "zlib.nrrd", values, "", "gz", zlib.compress(raw)))
    paths.append(nrrd(folder / "members.nrrd", values, "", "gzip", gzip.compress(raw[:101]) + gzip.compress(raw[101:])))
    paths.append(nrrd(folder / "bzip2.nrrd", values, "", "bzip2", bz2.compress(raw)))
    paths.append(nrrd(folder / "skip.nrrd", values, "line skip: 2\nbyte skip: 3", data=b"one\ntwo\nxyz" + raw))
    paths.append(nrrd(folder / "tail.nrrd", values, "byte skip: -1", data=b"anything" + raw))
    text = " ".join(str(value) for value in values.ravel()).encode()
    paths.append(nrrd(folder / "text.nrrd", values, "", "ascii", text))
    names = []
    for k, sheet in enumerate(values):
        names.append(f"sheet{k}.raw")
        (folder / names[-1]).write_bytes(sheet.tobytes())
    listed = "\n".join(names)
    paths.append(nrrd(folder / "list.nhdr", values, f"data file: LIST\n{listed}", data=b""))
    last = len(values) - 1
    paths.append(nrrd(folder / "numbered.nhdr", values, f"data file: sheet%d.raw 0 {last} 1", data=b""))
    sizes = " ".join(str(n) for n in values.shape[::-1])
    kind = {"uint16": "MET_USHORT", "int16": "MET_SHORT"}[values.dtype.name]
    meta = f"NDims = 3\nDimSize = {sizes}\nElementType = {kind}\n"
    for name, body, data in (
        ("list.mhd", f"ElementDataFile = LIST\n{listed}\n", b""),
        ("numbered.mhd", f"ElementDataFile = sheet%d.raw 0 {last} 1\n", b""),
        ("zlib.mha", "CompressedData = True\nElementDataFile = LOCAL\n", zlib.compress(raw)),
        ("big.mha", "BinaryDataByteOrderMSB = True\nElementDataFile = LOCAL\n", values.byteswap().tobytes()),
    ):
        (folder / name).write_bytes((meta + body).encode() + data)
        paths.append(folder / name)
    paths.append(dicom_series(folder / "dicom", values))
    return paths


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Voxels, list[Path]]:
    values = values_of("int16")
    return values, every_storage(tmp_path_factory.mktemp("storage"), values)


@given(data=st.data())
def test_a_box_equals_the_slice_of_the_whole(data: st.DataObject, stored: tuple[Voxels, list[Path]]) -> None:
    values, paths = stored
    corners = [sorted(data.draw(st.sets(st.integers(0, n), min_size=2, max_size=2))) for n in DIMS]
    (i0, i1), (j0, j1), (k0, k1) = corners
    for path in paths:
        got = open_volume(str(path)).read(Box((i0, j0, k0), (i1, j1, k1)))
        assert got.flags.c_contiguous and got.dtype == values.dtype
        np.testing.assert_array_equal(got, values[k0:k1, j0:j1, i0:i1], err_msg=path.name)


def test_rows_too_far_apart_are_read_one_by_one(tmp_path: Path) -> None:
    ni = READ_THROUGH_BYTES // 2 + 100
    values = np.arange(ni * 3 * 2, dtype=np.uint16).reshape(2, 3, ni)
    reader = open_volume(str(written(tmp_path / "wide.nrrd", values)))
    np.testing.assert_array_equal(reader.read(Box((40, 1, 0), (50, 3, 2))), values[:, 1:3, 40:50])


@pytest.mark.parametrize("extension", [".nrrd", ".nhdr", ".mha", ".mhd", ".nii"])
def test_only_the_sub_cube_is_read_from_raw_files(extension: str, tmp_path: Path) -> None:
    values = np.zeros((128, 128, 128), np.uint16)
    path = written(tmp_path / f"volume{extension}", values)
    read_whole(path)  # imports what the format needs
    reader = open_volume(str(path))
    assert reader.description.reads_sub_cubes
    for box, bytes_per_row in (
        (Box((0, 0, 64), (128, 128, 72)), 128 * 2),
        (Box((0, 32, 64), (128, 96, 72)), 128 * 2),
        (Box((64, 32, 64), (96, 96, 72)), 128 * 2),  # rows that lie so close together are read through
    ):
        before = bytes_read()
        reader.read(box)
        beyond = bytes_read() - before - bytes_per_row * box.size[1] * box.size[2]
        assert beyond < values.nbytes // 64


def test_a_description_reads_no_voxels(tmp_path: Path) -> None:
    path = written(tmp_path / "volume.nrrd", np.zeros((128, 128, 128), np.uint16))
    open_volume(str(path))
    before = bytes_read()
    open_volume(str(path))
    assert bytes_read() - before < path.stat().st_size // 32


def test_compressed_files_say_why_they_are_read_whole(tmp_path: Path) -> None:
    values = values_of("int16")
    for path in (
        written(tmp_path / "volume.nii.gz", values),
        nrrd(tmp_path / "volume.nrrd", values, "", "gzip", gzip.compress(values.tobytes())),
    ):
        description = open_volume(str(path)).description
        assert not description.reads_sub_cubes and description.why_whole


def test_slope_and_intercept_scale_the_values(tmp_path: Path) -> None:
    values = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    path = written(tmp_path / "volume.nii", values)
    raw = bytearray(path.read_bytes())
    raw[112:120] = np.array([0.5, -100], "<f4").tobytes()
    path.write_bytes(raw)
    assert open_volume(str(path)).description.scalar_type == "float32"
    np.testing.assert_array_equal(read_whole(path), values.astype(np.float32) / 2 - 100)


def test_one_frame_of_a_4d_file_is_a_volume(tmp_path: Path) -> None:
    values = values_of("int16")
    four = sitk.GetImageFromArray(values[None], isVector=False)
    for extension in (".nii", ".nii.gz", ".nrrd", ".mha"):
        path = tmp_path / f"four{extension}"
        sitk.WriteImage(four, str(path))
        np.testing.assert_array_equal(read_whole(path), values, err_msg=extension)


def test_dicom_slices_are_ordered_by_position(tmp_path: Path) -> None:
    values = values_of("int16")
    folder = dicom_series(tmp_path / "series", values)
    names = sorted(path.name for path in folder.iterdir())
    assert names != [f"{(n * 7) % 11}{n}" for n in range(len(values))]
    description = open_volume(str(folder)).description
    np.testing.assert_array_equal(read_whole(folder), values)
    assert description.geometry.index_to_physical == ((0.5, 0, 0), (0, 0.75, 0), (0, 0, 3))
    assert description.geometry.origin == (-10, 20, 0)
    assert description.anatomical and description.unit == "mm"


def test_a_tilted_gantry_stays_a_shear(tmp_path: Path) -> None:
    folder = dicom_series(tmp_path / "series", values_of("int16"), tilt=0.25)
    assert open_volume(str(folder)).description.geometry.index_to_physical[1] == (0, 0.75, 0.75)


def test_reading_is_silent(stored: tuple[Voxels, list[Path]], capfd: pytest.CaptureFixture[str]) -> None:
    for path in stored[1]:
        read_whole(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["plain.nrrd", "plain.nii", "plain.mha"])
@given(data=st.data())
def test_a_damaged_header_is_read_or_refused(name: str, data: st.DataObject, stored: tuple[Voxels, list[Path]]) -> None:
    original = next(path for path in stored[1] if path.name == name)
    raw = bytearray(original.read_bytes())
    end = len(raw) - stored[0].nbytes
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, end - 1))] = data.draw(st.integers(0, 255))
    damaged = original.with_name(f"damaged_{name}")
    damaged.write_bytes(raw)
    try:
        reader = open_volume(str(damaged))
        box = reader.description.geometry.box
        if math.prod(box.high) <= 8 * math.prod(DIMS):
            assert reader.read(box).shape == box.high[::-1]
    except BadInput as refusal:
        assert "\n" not in str(refusal)
