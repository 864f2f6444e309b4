"""DICOM: series told apart and chosen, multi-frame files, places as SimpleITK has them, and what is refused."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from pydicom.sequence import Sequence as Items

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.dicom_files import (
    BIG,
    ENHANCED_MR,
    LITTLE,
    MR,
    NUCLEAR,
    PET,
    RLE,
    SECONDARY,
    STRUCTURED_REPORT,
    enhanced,
    head,
    item,
    macro,
    numbered,
    saved,
    series,
    slice_file,
    with_pixels,
    without_preambles,
)
from support.files.opened import described, read_whole
from support.files.refusals import assert_refused_in_one_line
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.medicine.dicom_file import Frame, Place, dicom_file
from volsplat.mapshade_server.readers.medicine.dicom_series import told_series
from volsplat.mapshade_server.readers.medicine.dicom_stack import apart
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

VALUES = numbered(5)
PYDICOM_FILES = Path(pydicom.__file__).parent / "data" / "test_files"
emri = ("emri_small", "emri_small_big_endian", "emri_small_RLE", "emri_small_jpeg_2k_lossless")


def refused(name: Path | str) -> str:
    with pytest.raises(BadInput) as refusal:
        open_volume(str(name))
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


# Places


def turned(angles: tuple[float, float, float]) -> Voxels:
    """The row's and the column's direction and the normal, turned about z, y and x."""
    a, b, c = angles
    about_z = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(c), -math.sin(c)], [0, math.sin(c), math.cos(c)]])
    return np.asarray((about_z @ about_y @ about_x).T)


@pytest.mark.parametrize("along", [1, -1], ids=["up", "down"])
@pytest.mark.parametrize(
    "angles",
    [(0, 0, 0), (math.pi, 0, 0), (0, math.pi, 0), (0, 0, math.pi / 2), (0.3, -0.4, 1.1), (-2.2, 0.9, 2.5)],
    ids=["axial", "turned by half", "from behind", "coronal", "oblique", "oblique and flipped"],
)
def test_each_voxel_lies_where_simple_itk_has_it(
    angles: tuple[float, float, float], along: int, tmp_path: Path
) -> None:
    row, column, normal = turned(angles)
    paths = []
    for n, plane in enumerate(VALUES):
        position = np.array([5.0, -6.0, 7.0]) + along * 2.5 * n * normal
        paths.append(slice_file(tmp_path / f"{(n * 3) % 5}", plane, position.tolist(), [*row, *column]))
    reader = open_volume(str(tmp_path))
    geometry = reader.description.geometry
    voxels = reader.read(geometry.box)
    for path in paths:
        image = sitk.ReadImage(str(path), imageIO="GDCMImageIO")
        for i, j in ((0, 0), (6, 0), (2, 5)):
            place = np.array(image.TransformIndexToPhysicalPoint((i, j, 0)))
            matrix = np.array(geometry.index_to_physical)
            index = np.linalg.solve(matrix, place - np.array(geometry.origin))
            np.testing.assert_allclose(index, np.rint(index), atol=tolerances.GEOMETRY_FLOAT32)
            at = tuple(int(n) for n in np.rint(index))
            assert voxels[at[2], at[1], at[0]] == image[i, j, 0]


def test_the_phantom_lies_where_simple_itk_has_it(shared_data: Path) -> None:
    reader = open_volume(str(shared_data / "dicom_ct_phantom"))
    description = reader.description
    assert description.value_unit == "HU" and description.unit == "mm" and description.anatomical
    assert description.format == "DICOM CT series 201 “STD BRAIN 5MM”"
    for path in sorted((shared_data / "dicom_ct_phantom").iterdir())[::9]:
        image = sitk.ReadImage(str(path), imageIO="GDCMImageIO")
        k = round((image.GetOrigin()[2] - description.geometry.origin[2]) / 5)
        expected = image.TransformIndexToPhysicalPoint((100, 300, 0))
        assert description.geometry.physical((100, 300, k)) == pytest.approx(expected, rel=tolerances.GEOMETRY_PRINTED)
        sheet = reader.read(Box((0, 0, k), (512, 512, k + 1)))
        np.testing.assert_array_equal(sheet, sitk.GetArrayFromImage(image))


def test_a_dose_grid_lies_where_simple_itk_has_it() -> None:
    path = PYDICOM_FILES / "rtdose.dcm"
    image = sitk.ReadImage(str(path), imageIO="GDCMImageIO")
    reader = open_volume(str(path))
    description = reader.description
    geometry = description.geometry
    assert geometry.dims == image.GetSize() == (10, 10, 15) and description.value_unit == ""
    for index in ((0, 0, 0), (9, 0, 0), (2, 7, 14)):
        expected = image.TransformIndexToPhysicalPoint(index)
        place = geometry.physical((float(index[0]), float(index[1]), float(index[2])))
        assert place == pytest.approx(expected, rel=tolerances.GEOMETRY_PRINTED)
    np.testing.assert_allclose(reader.read(geometry.box), 1e-6 * sitk.GetArrayFromImage(image))
    np.testing.assert_array_equal(read_whole(PYDICOM_FILES / "rtdose_rle.dcm"), reader.read(geometry.box))
    np.testing.assert_array_equal(read_whole(PYDICOM_FILES / "rtdose_expb.dcm"), reader.read(geometry.box))


# Slices that are not evenly spaced


def ramp(heights: Sequence[float]) -> Voxels:
    """Planes whose values are ten times their height, so that between two of them values are known."""
    return np.stack([np.full((6, 7), round(10 * height), np.int16) for height in heights])


@pytest.mark.parametrize(
    ("heights", "step", "count"),
    [([0, 3, 6, 9.5, 12, 15], 2.5, 7), ([0, 1, 2.5, 4, 5, 6.5], 0.929, 8), ([0, 2, 4, 7, 10, 13], 1.857, 8)],
)
def test_uneven_slices_are_resampled_with_a_warning(
    heights: list[float], step: float, count: int, tmp_path: Path
) -> None:
    path = series(tmp_path / "s", ramp(heights), heights)
    reader = open_volume(str(path))
    description = reader.description
    assert description.geometry.spacing[2] == pytest.approx(step, abs=1e-3)
    assert description.geometry.dims[2] == count and description.geometry.origin[2] == 0
    assert "slices are unevenly spaced" in description.warnings[0] and "resampled to" in description.warnings[0]
    voxels = reader.read(description.geometry.box)
    expected = [np.rint(10 * description.geometry.physical((0.0, 0.0, float(k)))[2]) for k in range(count)]
    np.testing.assert_array_equal(voxels[:, 3, 2], expected)
    box = Box((1, 2, 2), (5, 4, 5))
    np.testing.assert_array_equal(reader.read(box), voxels[2:5, 2:4, 1:5])


def test_thicker_slices_further_apart_are_no_missing_slices(tmp_path: Path) -> None:
    heights = [0, 2.5, 5, 7.5, 10, 15, 20]
    for n, plane in enumerate(ramp(heights)):
        slice_file(tmp_path / f"{n}", plane, (0, 0, heights[n]), SliceThickness=2.5 if n < 5 else 5.0)
    description = described(tmp_path)
    assert description.geometry.dims[2] == 9 and "2.5 to 5 mm" in description.warnings[0]
    np.testing.assert_array_equal(read_whole(tmp_path)[:, 0, 0], [25 * k for k in range(9)])


def test_a_tilted_gantry_stays_a_shear_when_it_is_resampled(tmp_path: Path) -> None:
    heights = [0, 3, 6, 9.5, 12, 15]
    for n, plane in enumerate(ramp(heights)):
        slice_file(tmp_path / f"{n}", plane, (0, 0.25 * heights[n], heights[n]))
    matrix = described(tmp_path).geometry.index_to_physical
    assert (matrix[1][2], matrix[2][2]) == pytest.approx((0.625, 2.5))


def test_what_does_not_stack_is_told(tmp_path: Path) -> None:
    values = numbered(6)
    for name, heights, cause in (
        ("missing", [0, 3, 6, 12, 15, 18], "a slice is missing: .* are 6 mm apart, the others 3 mm"),
        ("several missing", [0, 3, 6, 15, 18, 21], "2 slices are missing"),
        ("far apart", [0, 1, 2, 3, 4, 64], "59 slices are missing: .* are 60 mm apart, the others 1 mm"),
        ("doubled", [0, 3, 6, 6, 9, 12], "lie at one position and nothing tells them apart"),
        ("most doubled", [0, 5, 5, 5, 5, 5], "lie at one position and nothing tells them apart"),
        ("nearly doubled", [0, 1e-4, 3, 3.0001, 6, 6.0001], "lie at one position and nothing tells them apart"),
    ):
        with pytest.raises(BadInput, match=cause):
            open_volume(str(series(tmp_path / name, values, heights)))
    shifted = tmp_path / "shifted"
    shifted.mkdir()
    for n, plane in enumerate(values):
        slice_file(shifted / f"{n}", plane, (2.0 if n == 3 else 0.0, 0, 3 * n))
    assert "slice 3 lies 2 mm beside the line" in refused(shifted)


# Series of a folder


def mixed(folder: Path) -> Path:
    """Two volumes, a scout, a screen shot in colour and a report, as a scanner leaves them."""
    series(folder, VALUES, SeriesInstanceUID="1.2.40", SeriesNumber=4, SeriesDescription="T2_AX")
    series(folder, VALUES[:3] + 500, SeriesInstanceUID="1.2.50", SeriesNumber=5, SeriesDescription="T1, AX")
    extras(folder)
    return folder


def extras(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    slice_file(folder / "scout", VALUES[0], (0, 0, 0), SeriesInstanceUID="1.2.10", SeriesNumber=1)
    shot = with_pixels(head(SECONDARY, SeriesInstanceUID="1.2.90", SeriesNumber=99), np.zeros((6, 21), np.uint8))
    shot.SamplesPerPixel, shot.PhotometricInterpretation, shot.PlanarConfiguration, shot.Columns = 3, "RGB", 0, 7
    saved(folder / "shot", shot)
    saved(folder / "report", head(STRUCTURED_REPORT, SeriesInstanceUID="1.2.91", Modality="SR"))
    (folder / "notes.txt").write_text("nothing")
    tifffile.imwrite(folder / "preview.tif", np.zeros((6, 7), np.uint8))


def test_a_folder_of_two_volumes_asks_which(tmp_path: Path) -> None:
    folder = mixed(tmp_path / "study")
    text = refused(folder)
    for told in (
        "holds 4 series",
        "4 “T2_AX”, 5 slices of 7 x 6",
        "5 “T1, AX”, 3 slices of 7 x 6",
        f"as in {folder}#4",
    ):
        assert told in text
    for part in ("4", "T2_AX", "t2_ax", "1.2.40"):
        np.testing.assert_array_equal(read_whole(f"{folder}#{part}"), VALUES)
    for part in ("5", "T1, AX", "1.2.50"):
        np.testing.assert_array_equal(read_whole(f"{folder}#{part}"), VALUES[:3] + 500)
    assert "no series is called “DWI”" in refused(f"{folder}#DWI")
    assert "one number a voxel" in refused(f"{folder}#99")


def test_the_only_volume_beside_scouts_is_taken_and_they_are_told(tmp_path: Path) -> None:
    folder = series(tmp_path / "study", VALUES, SeriesInstanceUID="1.2.40", SeriesNumber=4)
    slice_file(folder / "l0", VALUES[0], (0, 0, 0), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    slice_file(folder / "l1", VALUES[0], (0, 0, 9), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    extras(folder)
    np.testing.assert_array_equal(read_whole(folder), VALUES)
    warning = described(folder).warnings[0]
    assert "left out: " in warning and "1, 1 slice of 7 x 6" in warning
    assert not described(f"{folder}#4").warnings


def test_series_of_one_number_and_name_are_chosen_by_uid(tmp_path: Path) -> None:
    for uid, values in (("1.2.4", VALUES), ("1.2.44", VALUES[:3])):
        series(tmp_path, values, SeriesInstanceUID=uid, SeriesNumber=2, SeriesDescription="T2")
    text = refused(f"{tmp_path}#T2")
    assert "holds 2 series called “T2”" in text and "UID 1.2.44" in text and "by how its UID begins" in text
    np.testing.assert_array_equal(read_whole(f"{tmp_path}#1.2.4"), VALUES)
    np.testing.assert_array_equal(read_whole(f"{tmp_path}#1.2.44"), VALUES[:3])


def test_real_studies_are_told_apart() -> None:
    study = PYDICOM_FILES / "dicomdirtests"
    description = described(study / "98892001")
    assert description.format == "DICOM CT series 5 “SmartScore - Gated 0.5 sec”"
    assert description.geometry.dims == (16, 16, 5) and "4 “Scout”, 2 slices" in description.warnings[0]
    assert "700 “ANGIO Projected from   C”, 7 slices" in refused(study / "98892003")
    assert "7 single slices that do not belong together" in refused(study / "98892003" / "MR700")
    assert "161 slices are missing" in refused(study / "77654033" / "CT2")


# Several volumes in one series


def test_orientations_and_echoes_and_times_of_a_series_are_told_apart(tmp_path: Path) -> None:
    sagittal = (0.0, 1.0, 0.0, 0.0, 0.0, -1.0)
    for n in range(3):
        slice_file(tmp_path / f"s{n}", VALUES[n], (3 * n, 0, 0), sagittal, EchoNumbers=1, kind=MR)
        for echo in (1, 2):
            for time in (1, 2, 3):
                plane = VALUES[n] + 100 * echo + 10 * time
                tags: dict[str, Any] = {"EchoNumbers": echo, "TemporalPositionIdentifier": time, "kind": MR}
                slice_file(tmp_path / f"a{n}{echo}{time}", plane, (0, 0, 3 * n), **tags)
    text = refused(tmp_path)
    for told in (
        "holds 7 volumes",
        "2 by orientation (orientation=axial, orientation=sagittal)",
        "2 by echo (echo=1, echo=2)",
        "3 by time (time=1, time=2, time=3)",
        f"choose, as in {tmp_path}#orientation=axial,echo=1,time=1",
    ):
        assert told in text
    np.testing.assert_array_equal(read_whole(f"{tmp_path}#echo=2,time=3"), VALUES[:3] + 230)
    np.testing.assert_array_equal(read_whole(f"{tmp_path}#orientation=sagittal")[::-1], VALUES[:3])
    assert described(f"{tmp_path}#time=1,echo=1").name.endswith("#orientation=axial,echo=1,time=1")
    assert "has no echo=3: 2 by echo" in refused(f"{tmp_path}#echo=3")
    assert "nothing to choose by that" in refused(f"{tmp_path}#b=1000")


def test_magnitude_and_phase_are_told_apart_by_the_type_of_image(tmp_path: Path) -> None:
    for n in range(3):
        for kind, add in (("M", 0), ("P", 500)):
            name = ["ORIGINAL", "PRIMARY", kind, "NORM"]
            slice_file(tmp_path / f"{n}{kind}", VALUES[n] + add, (0, 0, 3 * n), ImageType=name, kind=MR)
    assert "2 by type (type=M, type=P)" in refused(tmp_path)
    np.testing.assert_array_equal(read_whole(f"{tmp_path}#type=P"), VALUES[:3] + 500)


PHASES: dict[str, tuple[str, Sequence[Any]]] = {
    "flip": ("FlipAngle", (5, 15)),
    "inversion": ("InversionTime", (50, 400)),
    "gradient": ("DiffusionGradientOrientation", ([1.0, 0.0, 0.0], [0.0, 0.6, 0.8])),
    "acquired": ("AcquisitionTime", ("120001", "120002.5")),
    "content": ("ContentTime", ("120001", "120002.5")),
}


@pytest.mark.parametrize("key", PHASES)
def test_phases_that_one_tag_sets_apart_are_told_apart(key: str, tmp_path: Path) -> None:
    tag, values = PHASES[key]
    for phase, value in enumerate(values):
        for n in range(3):
            slice_file(tmp_path / f"{n}{phase}", VALUES[n] + 100 * phase, (0, 0, 3 * n), kind=MR, **{tag: value})
    assert f"2 by {key} (" in refused(tmp_path)
    for phase, value in enumerate(values):
        words = "/".join(f"{x:g}" for x in value) if isinstance(value, list) else value
        np.testing.assert_array_equal(read_whole(f"{tmp_path}#{key}={words}"), VALUES[:3] + 100 * phase)


@pytest.mark.parametrize("tag", ["AcquisitionTime", "ContentTime"])
def test_a_time_of_each_slice_sets_no_volumes_apart(tag: str, tmp_path: Path) -> None:
    times: list[dict[str, Any]] = [{tag: f"12000{n}"} for n in range(5)]
    for n in range(4):
        slice_file(tmp_path / f"s{n}", VALUES[n], (0, 0, 3 * n), kind=MR, **times[n])
    np.testing.assert_array_equal(read_whole(tmp_path), VALUES[:4])
    slice_file(tmp_path / "s4", VALUES[3], (0, 0, 9), kind=MR, **times[4])
    assert "slices s3 and s4 lie at one position and nothing tells them apart" in refused(tmp_path)


@pytest.mark.parametrize(("key", "tag"), [("acquired", "AcquisitionTime"), ("content", "ContentTime")])
def test_a_slice_that_one_of_two_times_lacks_is_told(key: str, tag: str, tmp_path: Path) -> None:
    for n in range(9):
        tags: dict[str, Any] = {"kind": MR, tag: f"12000{n // 5}"}
        slice_file(tmp_path / f"s{n}", VALUES[n % 5], (0, 0, 3 * (n % 5)), **tags)
    told = refused(tmp_path)
    assert f"{key} tells volumes apart, but slices are missing: {key}=120001 has 4 of 5; complete the series" in told
    slice_file(tmp_path / "s9", VALUES[4] + 100, (0, 0, 12), **tags)
    np.testing.assert_array_equal(read_whole(f"{tmp_path}#{key}=120000"), VALUES)


@pytest.mark.parametrize("directions", [([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), ([0.6, 0.0, 0.8], [0.6, 0.8, 0.0])])
def test_directions_of_diffusion_are_named_whole(directions: Sequence[Sequence[float]], tmp_path: Path) -> None:
    for phase, direction in enumerate(directions):
        tags: dict[str, Any] = {"kind": MR, "DiffusionGradientOrientation": direction}
        for n in range(3):
            slice_file(tmp_path / f"{n}{phase}", VALUES[n] + 100 * phase, (0, 0, 3 * n), **tags)
    for phase, direction in enumerate(directions):
        words = "/".join(f"{x:g}" for x in direction)
        np.testing.assert_array_equal(read_whole(f"{tmp_path}#gradient={words}"), VALUES[:3] + 100 * phase)


# Multi-frame files


def places(order: Sequence[int]) -> list[tuple[float, float, float]]:
    return [(-10.0, 20.0, 2.5 * n) for n in order]


def test_a_multi_frame_file_lies_where_simple_itk_has_it(tmp_path: Path) -> None:
    path = enhanced(tmp_path / "e.dcm", VALUES, places(range(5)))
    reader = open_volume(str(path))
    geometry = reader.description.geometry
    image = sitk.ReadImage(str(path), imageIO="GDCMImageIO")
    for index in ((0, 0, 0), (6, 0, 0), (2, 5, 4)):
        expected = image.TransformIndexToPhysicalPoint(index)
        assert geometry.physical((float(index[0]), float(index[1]), float(index[2]))) == pytest.approx(expected)
    np.testing.assert_array_equal(reader.read(geometry.box), sitk.GetArrayFromImage(image))


@pytest.mark.parametrize("syntax", [LITTLE, BIG, RLE])
def test_frames_are_ordered_by_their_positions(syntax: str, tmp_path: Path) -> None:
    order = [3, 0, 4, 1, 2]
    path = enhanced(tmp_path / "e.dcm", VALUES[order], places(order), syntax=syntax)
    for name in (path, tmp_path):
        reader = open_volume(str(name))
        geometry = reader.description.geometry
        assert geometry.index_to_physical == ((0.5, 0, 0), (0, 0.75, 0), (0, 0, 2.5))
        assert geometry.origin == (-10, 20, 0)
        np.testing.assert_array_equal(reader.read(geometry.box), VALUES)
        np.testing.assert_array_equal(reader.read(Box((1, 2, 1), (5, 4, 4))), VALUES[1:4, 2:4, 1:5])


def test_echoes_and_times_of_a_multi_frame_file_are_told_apart(tmp_path: Path) -> None:
    frames, positions, groups = [], [], []
    for time in (1, 2):
        for echo in (2.5, 10.0):
            for n in range(3):
                frames.append(VALUES[n] + 100 * time + int(echo))
                positions.append(places([n])[0])
                content = macro("FrameContentSequence", TemporalPositionIndex=time, StackID="1")
                groups.append(content | macro("MREchoSequence", EffectiveEchoTime=echo))
    path = enhanced(tmp_path / "e.dcm", np.stack(frames), positions, groups)
    text = refused(path)
    assert "2 by te (te=2.5, te=10)" in text and "2 by time (time=1, time=2)" in text
    np.testing.assert_array_equal(read_whole(f"{path}#te=10,time=2"), VALUES[:3] + 210)
    with pytest.raises(BadInput, match="none called “T9”"):
        open_volume(f"{path}#T9,te=10,time=2")


def test_directions_of_diffusion_of_a_multi_frame_file_are_told_apart(tmp_path: Path) -> None:
    directions = (None, [1.0, 0.0, 0.0], [0.0, 0.6, 0.8])
    groups = []
    for direction in directions:
        inner = macro("DiffusionGradientDirectionSequence", DiffusionGradientOrientation=direction) if direction else {}
        groups += [macro("MRDiffusionSequence", DiffusionBValue=1000.0 if direction else 0.0, **inner)] * 3
    values = numbered(9)
    path = enhanced(tmp_path / "e.dcm", values, places([0, 1, 2] * 3), groups)
    assert "2 by b (b=0, b=1000) and 2 by gradient (gradient=1/0/0, gradient=0/0.6/0.8)" in refused(path)
    np.testing.assert_array_equal(read_whole(f"{path}#b=0"), values[:3])
    np.testing.assert_array_equal(read_whole(f"{path}#gradient=0/0.6/0.8"), values[6:])


def test_stacks_that_are_turned_are_told_apart(tmp_path: Path) -> None:
    coronal = macro("PlaneOrientationSequence", ImageOrientationPatient=[1, 0, 0, 0, 0, -1])
    axial = macro("PlaneOrientationSequence", ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    positions = [*places(range(2)), (0.0, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, 8.0, 0.0)]
    groups = [axial, axial, coronal, coronal, coronal]
    path = enhanced(tmp_path / "e.dcm", VALUES, positions, groups, {"PlaneOrientationSequence": Items([])})
    assert "2 by orientation (orientation=axial, orientation=coronal)" in refused(path)
    np.testing.assert_array_equal(read_whole(f"{path}#orientation=coronal"), VALUES[2:])
    assert described(f"{path}#orientation=coronal").geometry.spacing[2] == 4


def test_more_orientations_than_a_study_has_are_refused_however_many_there_are(tmp_path: Path) -> None:
    told = dicom_file(slice_file(tmp_path / "s", VALUES[0], (0, 0, 0)))
    assert told is not None
    first = told.frames[0]

    def turned_by(n: int) -> Frame:
        angle = n * math.tau / 200_000
        return replace(first, place=Place((0.0, 0.0, 0.0), (math.cos(angle), math.sin(angle), 0.0), (0.0, 0.0, 1.0)))

    frames = [turned_by(n) for n in range(200_000)]
    with pytest.raises(BadInput, match="are turned in more than 64 ways"):
        apart(tmp_path, frames)
    assert len(apart(tmp_path, frames[:: 200_000 // 64])) == 64


def test_a_series_of_too_many_orientations_is_left_out_of_a_list(tmp_path: Path) -> None:
    paths = sorted(series(tmp_path, VALUES, SeriesDescription="HEAD").iterdir())
    for n in range(65):
        angle = n * math.tau / 65
        row = (math.cos(angle), math.sin(angle), 0, 0, 0, 1)
        paths.append(slice_file(tmp_path / f"t{n}", VALUES[0], (0, 0, 0), row, SeriesInstanceUID="1.2.9"))
    assert [told for _, told in told_series(paths)] == ["series without number “HEAD”, 5 slices of 7 x 6"]
    assert "are turned in more than 64 ways" in refused(f"{tmp_path}#1.2.9")


def test_each_frame_has_its_own_rescale(tmp_path: Path) -> None:
    groups = [
        macro("PixelValueTransformationSequence", RescaleSlope=slope, RescaleIntercept=0.5, RescaleType="US")
        for slope in (1, 2, 3, 4, 5)
    ]
    path = enhanced(tmp_path / "e.dcm", VALUES, places(range(5)), groups)
    assert described(path).scalar_type == "float32" and described(path).value_unit == ""
    factors = np.arange(1, 6).reshape(5, 1, 1)
    np.testing.assert_array_equal(read_whole(path), (VALUES * factors + 0.5).astype(np.float32))


def test_the_real_multi_frame_files_are_equal_in_every_packing(
    shared_data: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    paths = [shared_data / "dicom_multiframe" / f"{name}.dcm" for name in emri]
    expected = sitk.GetArrayFromImage(sitk.ReadImage(str(paths[0]), imageIO="GDCMImageIO"))
    for path in paths:
        description = described(path)
        assert description.geometry.dims == (64, 64, 10) and description.geometry.spacing == (1, 1, 1.2)
        assert not description.anatomical and "states no places of its frames" in description.warnings[0]
        np.testing.assert_array_equal(read_whole(path), expected)
    assert capfd.readouterr() == ("", "")


PIXELS = {"PixelSpacing": [0.75, 0.5]}
UNPLACED: dict[str, tuple[int, dict[str, Any], tuple[float, float, float], str]] = {
    "all is stated": (
        5,
        PIXELS | {"SpacingBetweenSlices": 1.0, "SliceThickness": 2.0},
        (0.5, 0.75, 1),
        "in their order, 1 mm apart, with pixels of 0.5 x 0.75 mm",
    ),
    "thick": (5, PIXELS | {"SliceThickness": 2.0}, (0.5, 0.75, 2), "2 mm apart, as thick as they are"),
    "pixels alone": (5, PIXELS, (0.5, 0.75, 0.5), "one pixel apart, with pixels of 0.5 x 0.75 mm"),
    "slices alone": (5, {"SpacingBetweenSlices": 3.0}, (1, 1, 3), "3 mm apart, with pixels of 1 mm"),
    "one slice": (1, PIXELS | {"SliceThickness": 2.0}, (0.5, 0.75, 2), "no place of its slice"),
    "one slice, thick": (1, {"SliceThickness": 2.0}, (1, 1, 1), "no place of its slice, and no size of its pixels"),
}


@pytest.mark.parametrize("packed", [False, True], ids=["plain", "enhanced"])
@pytest.mark.parametrize("case", UNPLACED)
def test_frames_without_a_place_are_as_large_as_the_file_states(case: str, packed: bool, tmp_path: Path) -> None:
    planes, tags, spacing, told = UNPLACED[case]
    shared = {"SharedFunctionalGroupsSequence": Items([item(**macro("PixelMeasuresSequence", **tags))])}
    one = head(MR, Modality="MR", MRAcquisitionType="3D", **(shared if packed else tags))
    path = saved(tmp_path / "nowhere.dcm", with_pixels(one, VALUES[:planes]))
    description = described(path if planes > 1 else f"{path}#slice")
    assert description.geometry.spacing == spacing and not description.anatomical
    assert description.unit == ("mm" if "PixelSpacing" in tags else "") and told in description.warnings[0]


def test_a_picture_whose_spacing_is_no_number_is_left_out(tmp_path: Path) -> None:
    folder = series(tmp_path / "study", VALUES)
    picture = with_pixels(head(SECONDARY, SeriesInstanceUID="9.9", PixelSpacing=[0.5, 0.5]), VALUES[0])
    raw = saved(folder / "picture", picture).read_bytes()
    assert raw.count(b"0.5\\0.5") == 1
    (folder / "picture").write_bytes(raw.replace(b"0.5\\0.5", b"0,5\\0,5"))
    np.testing.assert_array_equal(read_whole(folder), VALUES)


@pytest.mark.parametrize("step", [2.5, -2.5])
def test_slices_of_nuclear_medicine_lie_where_simple_itk_has_them(step: float, tmp_path: Path) -> None:
    row, column, _ = turned((0.3, -0.4, 1.1))
    tags: dict[str, Any] = {"PixelSpacing": [0.75, 0.5], "SpacingBetweenSlices": step, "SliceVector": [1, 2, 3, 4, 5]}
    directions = [round(float(x), 8) for x in (*row, *column)]
    detector = item(ImagePositionPatient=[5.0, -6.0, 7.0], ImageOrientationPatient=directions)
    one = head(NUCLEAR, Modality="NM", DetectorInformationSequence=Items([detector]), **tags)
    path = saved(tmp_path / "spect.dcm", with_pixels(one, VALUES.astype(np.uint16)))
    image = sitk.ReadImage(str(path), imageIO="GDCMImageIO")
    geometry = described(path).geometry
    values = read_whole(path)
    for index in ((0, 0, 0), (6, 0, 1), (2, 5, 4)):
        i, j, k = index[0], index[1], index[2] if step > 0 else 4 - index[2]
        expected = image.TransformIndexToPhysicalPoint(index)
        assert geometry.physical((float(i), float(j), float(k))) == pytest.approx(
            expected, rel=tolerances.GEOMETRY_PRINTED
        )
        assert values[k, j, i] == image[index] == VALUES[index[::-1]]


def test_thousands_of_slices_of_nuclear_medicine_open_in_seconds(tmp_path: Path) -> None:
    """What the file lists for all frames is not gone through for each: of this many that took 40 s."""
    count = 16384
    detector = item(ImagePositionPatient=[5.0, -6.0, 7.0], ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    one = head(NUCLEAR, Modality="NM", DetectorInformationSequence=Items([detector]), PixelSpacing=[1, 1])
    one.SpacingBetweenSlices, one.SliceVector = 0.5, list(range(1, count + 1))
    path = saved(tmp_path / "spect.dcm", with_pixels(one, np.zeros((count, 2, 2), np.uint16)))
    begun = process_time()
    assert described(path).geometry.dims == (2, 2, count)
    assert process_time() - begun < 15


def test_one_place_for_all_frames_is_told(tmp_path: Path) -> None:
    one = head(SECONDARY, ImagePositionPatient=[1, 2, 3], ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    one.PixelSpacing = [0.75, 0.5]
    text = refused(saved(tmp_path / "film.dcm", with_pixels(one, VALUES)))
    assert "has 5 frames and one place for all of them" in text


def test_a_palette_is_told_to_be_left_out(tmp_path: Path) -> None:
    for n, plane in enumerate(VALUES.astype(np.uint8)):
        one = with_pixels(head(ImagePositionPatient=[0, 0, n], ImageOrientationPatient=[1, 0, 0, 0, 1, 0]), plane)
        one.PixelSpacing, one.PhotometricInterpretation = [1, 1], "PALETTE COLOR"
        saved(tmp_path / str(n), one)
    assert "palette of colours is left out" in described(tmp_path).warnings[0]
    np.testing.assert_array_equal(read_whole(tmp_path), VALUES.astype(np.uint8))


def test_a_film_of_one_slice_is_no_volume(tmp_path: Path) -> None:
    film = with_pixels(head(SECONDARY, Modality="US"), VALUES)
    assert "a film of one slice is no volume" in refused(saved(tmp_path / "film.dcm", film))


# Stored values


MR_SMALL = (
    "MR_small_RLE",
    "MR_small_bigendian",
    "MR_small_expb",
    "MR_small_implicit",
    "MR_small_jp2klossless",
    "MR_small_jpeg_ls_lossless",
    "MR_small_padded",
)


def real_slice(folder: Path, name: str) -> Path:
    """A folder with a real slice twice, the second 3 mm along its normal, so that it is a volume."""
    source = PYDICOM_FILES / f"{name}.dcm"
    raw = source.read_bytes()
    (folder / "a").write_bytes(raw)
    other = pydicom.dcmread(source)
    row, column = np.array(other.ImageOrientationPatient).reshape(2, 3)
    moved = np.array(other.ImagePositionPatient) + 3 * np.cross(row, column)
    other.ImagePositionPatient = [round(float(x), 6) for x in moved]
    other.save_as(folder / "b")
    return folder


@pytest.mark.parametrize("name", MR_SMALL)
def test_real_slices_are_equal_in_every_packing(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    expected = sitk.GetArrayFromImage(sitk.ReadImage(str(PYDICOM_FILES / "MR_small.dcm"), imageIO="GDCMImageIO"))[0]
    for plane in read_whole(real_slice(tmp_path, name)):
        np.testing.assert_array_equal(plane, expected)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["JPEG-lossy", "JPGExtended", "JPEGLSNearLossless_16", "693_J2KI"])
def test_lossy_slices_are_decoded_as_simple_itk_does_and_in_silence(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    image = sitk.ReadImage(str(PYDICOM_FILES / f"{name}.dcm"), imageIO="GDCMImageIO")
    capfd.readouterr()
    source = pydicom.dcmread(PYDICOM_FILES / f"{name}.dcm")
    source.ImageOrientationPatient, source.PixelSpacing = [1, 0, 0, 0, 1, 0], [1, 1]
    for n in range(2):
        source.ImagePositionPatient = [0, 0, n]
        source.save_as(tmp_path / f"{n}")
    expected = sitk.GetArrayFromImage(image).reshape(image.GetSize()[1::-1]).astype(np.float64)
    if name == "693_J2KI":  # states a padding of -3024 HU
        expected[expected < -2024] = np.nan
    np.testing.assert_array_equal(read_whole(tmp_path)[1], expected)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("scalar_type", ["uint8", "int8", "uint16", "int16", "uint32", "int32"])
def test_every_stored_type_comes_back(scalar_type: str, tmp_path: Path) -> None:
    values = VALUES.astype(scalar_type)
    values[0, 0, :2] = np.iinfo(scalar_type).min, np.iinfo(scalar_type).max
    path = series(tmp_path / "s", values)
    assert described(path).scalar_type == scalar_type
    np.testing.assert_array_equal(read_whole(path), values)


def test_bits_beyond_the_stored_ones_do_not_count(tmp_path: Path) -> None:
    for kind, junk in ((np.uint16, 0xF000), (np.int16, 0x7000)):
        values = (VALUES - (100 if kind is np.int16 else 0)).astype(kind)
        dirty = ((values.view(np.uint16) & 0x0FFF) | junk).view(kind)
        folder = tmp_path / kind.__name__
        folder.mkdir()
        for n, plane in enumerate(dirty):
            one = with_pixels(head(), plane, bits_stored=12)
            one.ImagePositionPatient, one.ImageOrientationPatient = [0, 0, n], [1, 0, 0, 0, 1, 0]
            one.PixelSpacing = [1, 1]
            saved(folder / str(n), one)
        np.testing.assert_array_equal(read_whole(folder), values)


def test_whole_rescales_keep_whole_types_and_others_become_floats(tmp_path: Path) -> None:
    values = VALUES.astype(np.uint16)
    for slope, intercept, bits, expected in ((1, -1024, 12, "int16"), (1, -1024, 16, "int32"), (0.5, 0, 12, "float32")):
        folder = tmp_path / f"{slope}{bits}"
        folder.mkdir()
        for n, plane in enumerate(values):
            one = with_pixels(head(RescaleSlope=slope, RescaleIntercept=intercept), plane, bits_stored=bits)
            one.ImagePositionPatient, one.ImageOrientationPatient = [0, 0, n], [1, 0, 0, 0, 1, 0]
            one.PixelSpacing = [1, 1]
            saved(folder / str(n), one)
        assert described(folder).scalar_type == expected and described(folder).value_unit == "HU"
        np.testing.assert_array_equal(read_whole(folder), values.astype(np.float64) * slope + intercept)


@pytest.mark.parametrize(("intercept", "nothing"), [(-1024, True), (1000, False)])
def test_padding_below_air_is_no_data(intercept: int, nothing: bool, tmp_path: Path) -> None:
    values = VALUES.copy()
    values[:, 0], values[:, 1] = -1992, -900
    tags: dict[str, Any] = {"RescaleSlope": 1, "RescaleIntercept": intercept}
    padding = item(PixelPaddingValue=-2000, PixelPaddingRangeLimit=-1995)
    padding["PixelPaddingValue"].VR = padding["PixelPaddingRangeLimit"].VR = "SS"
    for n, plane in enumerate(values):
        one = with_pixels(head(**tags), plane)
        one.ImagePositionPatient, one.ImageOrientationPatient = [0, 0, n], [1, 0, 0, 0, 1, 0]
        one.PixelSpacing = [1, 1]
        one.update(padding)
        saved(tmp_path / str(n), one)
    voxels = read_whole(tmp_path)
    assert described(tmp_path).scalar_type == ("float32" if nothing else "int32")
    assert np.isnan(voxels[:, 0]).all() == nothing
    np.testing.assert_array_equal(voxels[:, 1:], values[:, 1:].astype(int) + intercept)


def test_slices_of_a_pet_have_their_own_slopes(tmp_path: Path) -> None:
    for n, plane in enumerate(VALUES):
        tags: dict[str, Any] = {
            "RescaleSlope": 0.25 * (n + 1),
            "RescaleIntercept": 0,
            "Units": "BQML",
            "Modality": "PT",
            "kind": PET,
        }
        slice_file(tmp_path / f"{n}", plane, (0, 0, 3 * n), **tags)
    assert described(tmp_path).value_unit == "Bq/ml"
    np.testing.assert_array_equal(read_whole(tmp_path), VALUES * (0.25 * np.arange(1, 6)).reshape(5, 1, 1))


def test_a_table_of_values_is_looked_up_and_holds_beyond_its_ends(tmp_path: Path) -> None:
    table = item(LUTDescriptor=[100, 10, 16], ModalityLUTType="HU", LUTData=[3 * n + 7 for n in range(100)])
    table["LUTDescriptor"].VR = table["LUTData"].VR = "US"
    values = VALUES.astype(np.uint16)
    for n, plane in enumerate(values):
        slice_file(tmp_path / f"{n}", plane, (0, 0, 3 * n), ModalityLUTSequence=Items([table]))
    description = described(tmp_path)
    assert description.value_unit == "HU" and description.scalar_type == "uint16"
    np.testing.assert_array_equal(read_whole(tmp_path), 3 * np.clip(values.astype(int) - 10, 0, 99) + 7)


def test_old_files_without_a_preamble_are_found(tmp_path: Path) -> None:
    folder = without_preambles(series(tmp_path / "s", VALUES))
    old = max(folder.iterdir())
    (folder / "raw").write_bytes(np.arange(8, 4000, dtype="<u2").tobytes())
    np.testing.assert_array_equal(read_whole(folder), VALUES)
    np.testing.assert_array_equal(read_whole(old), VALUES)
    assert read_whole(f"{old}#slice").shape == (1, *VALUES.shape[1:])
    size = old.stat().st_size
    assert read_whole(f"{old}#dims={size}x1x1,type=uint8").shape == (1, 1, size)


# What is read


def test_only_the_rows_of_the_sub_cube_are_read(tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 4000, (32, 128, 128)).astype(np.int16)
    box = Box((0, 32, 8), (128, 64, 16))
    whole = enhanced(tmp_path / "e.dcm", values, places(range(32)))
    for path in (series(tmp_path / "s", values), whole):
        reader = open_volume(str(path))
        assert reader.description.reads_sub_cubes
        before = bytes_read()
        np.testing.assert_array_equal(reader.read(box), values[8:16, 32:64])
        assert bytes_read() - before < box.voxels * 2 + 4096


def test_one_packed_frame_needs_no_other(tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 4000, (32, 128, 128)).astype(np.int16)
    counts = []
    for frames in (4, 4, 32):  # the first imports what the format needs
        path = enhanced(tmp_path / "e.dcm", values[:frames], places(range(frames)), syntax=RLE)
        reader = open_volume(str(path))
        before = bytes_read()
        np.testing.assert_array_equal(reader.read(Box((0, 0, 2), (128, 128, 3))), values[2:3])
        counts.append(bytes_read() - before)
    assert counts[2] - counts[1] < values[0].nbytes


def test_a_description_reads_no_pixels(tmp_path: Path) -> None:
    path = enhanced(tmp_path / "e.dcm", np.zeros((64, 128, 128), np.int16), places(range(64)))
    open_volume(str(path))
    before = bytes_read()
    open_volume(str(path))
    assert bytes_read() - before < path.stat().st_size // 16


# What is refused


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def edited(folder: Path, **tags: Any) -> Path:
    """A series whose first file has other tags, or has them no more."""
    path = sorted(series(folder / "s", VALUES).iterdir())[0]
    one = pydicom.dcmread(path)
    for name, value in tags.items():
        if value is None:
            delattr(one, name)
        else:
            setattr(one, name, value)
    one.save_as(path)
    return folder / "s"


def cut_slice(folder: Path, share: float, **tags: Any) -> Path:
    path = sorted(series(folder / "s", VALUES, **tags).iterdir())[0]
    cut(path, share)
    return folder / "s"


def missing_frames(path: Path) -> Path:
    one = pydicom.dcmread(enhanced(path, VALUES, places(range(5)), syntax=RLE))
    one.NumberOfFrames = 7
    one.save_as(path)
    return path


def damaged_frame(path: Path) -> Path:
    raw = bytearray(enhanced(path, VALUES, places(range(5)), syntax=RLE).read_bytes())
    table = raw.index(b"\xfe\xff\x00\xe0", raw.index(b"\xe0\x7f\x10\x00"))
    start = raw.index(b"\xfe\xff\x00\xe0", table + 8) + 8
    raw[start : start + 64] = b"\xff" * 64
    path.write_bytes(raw)
    return path


def many_frames(path: Path) -> Path:
    one = with_pixels(head(ENHANCED_MR), np.zeros((2_000_000, 1, 1), np.uint8))
    return saved(path, one)


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "a single slice": (lambda d: slice_file(d / "a.dcm", VALUES[0], (0, 0, 0)), "give the folder of the whole series"),
    "one slice in a folder": (lambda d: series(d / "s", VALUES[:1]), "a 2-D image, volsplat needs a volume"),
    "colour": (lambda d: Path(PYDICOM_FILES / "SC_rgb_rle_2frame.dcm"), "3 samples a pixel (RGB)"),
    "a mosaic": (lambda d: edited(d, ImageType=["ORIGINAL", "PRIMARY", "M", "MOSAIC"]), "mosaic of slices"),
    "one bit": (lambda d: Path(PYDICOM_FILES / "liver_1frame.dcm"), "1-bit pixels"),
    "deflated": (lambda d: Path(PYDICOM_FILES / "image_dfl.dcm"), "deflated as a whole"),
    "truncated pixels": (lambda d: cut_slice(d, 0.95), "truncated"),
    "truncated header": (lambda d: cut_slice(d, 0.6), "truncated"),
    "truncated preamble": (lambda d: cut_slice(d, 0.25), "truncated"),
    "truncated frames": (lambda d: cut(enhanced(d / "e.dcm", VALUES, places(range(5))), 0.95), "truncated"),
    "truncated packed frames": (
        lambda d: cut(enhanced(d / "e.dcm", VALUES, places(range(5)), syntax=RLE), 0.95),
        "truncated within its packed frames",
    ),
    "a damaged packed frame": (lambda d: damaged_frame(d / "e.dcm"), "frame 0 cannot be decoded"),
    "packed frames missing": (lambda d: missing_frames(d / "e.dcm"), "promises 7 frames and holds 5"),
    "no position": (lambda d: edited(d, ImagePositionPatient=None), "no usable ImagePositionPatient"),
    "no orientation": (lambda d: edited(d, ImageOrientationPatient=None), "no usable ImageOrientationPatient"),
    "directions that are not square": (
        lambda d: edited(d, ImageOrientationPatient=[1, 0, 0, 1, 0, 0]),
        "no usable ImageOrientationPatient",
    ),
    "no spacing": (lambda d: edited(d, PixelSpacing=None), "no usable PixelSpacing"),
    "zero spacing": (lambda d: edited(d, PixelSpacing=[0, 1]), "no usable PixelSpacing"),
    "a rescale by zero": (lambda d: edited(d, RescaleSlope=0, RescaleIntercept=0), "makes no sense"),
    "another size": (lambda d: edited(d, Rows=5), "differ in size"),
    "more rows than there are": (lambda d: edited(d, Rows=60), "promises"),
    "another spacing": (lambda d: edited(d, PixelSpacing=[2, 2]), "differ in size or pixel spacing"),
    "frames without end": (lambda d: many_frames(d / "e.dcm"), "promises 2000000 frames, and no more than 65536 are"),
    "impossible bits": (lambda d: edited(d, BitsStored=20), "make no sense"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_what_is_wrong_is_told_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    assert_refused_in_one_line(read_whole, make(tmp_path), cause, capfd)


@pytest.fixture(scope="module")
def undamaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    groups = [macro("PixelValueTransformationSequence", RescaleSlope=1, RescaleIntercept=-9)] * 5
    return enhanced(tmp_path_factory.mktemp("dicom") / "e.dcm", VALUES, places(range(5)), groups, kind=ENHANCED_MR)


@given(data=st.data())
def test_a_damaged_header_is_read_or_refused(data: st.DataObject, undamaged: Path) -> None:
    raw = bytearray(undamaged.read_bytes())
    end = len(raw) - VALUES.nbytes
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(140, end - 1))] = data.draw(st.integers(0, 255))
    path = undamaged.with_name("damaged.dcm")
    path.write_bytes(raw)
    try:
        reader = open_volume(str(path))
        box = reader.description.geometry.box
        if math.prod(box.high) <= 8 * VALUES.size:
            assert reader.read(box).shape == box.high[::-1]
    except BadInput as refusal:
        assert "\n" not in str(refusal)
