"""Series of volumes in NIfTI, NRRD and MetaImage: one frame is chosen by its number, and only that one is read."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import refused
from support.files.volume_files import values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

SERIES = values_of("int16", (7, 6, 20)).reshape(4, 5, 6, 7)  # frame, k, j, i


def by_simple_itk(path: Path, compressed: bool = False) -> Path:
    sitk.WriteImage(sitk.GetImageFromArray(SERIES, isVector=False), str(path), compressed)
    return path


def nrrd(path: Path, kinds: str, directions: str, stored: Voxels, encoding: str = "raw") -> Path:
    sizes = " ".join(str(n) for n in stored.shape[::-1])
    fields = f"{kinds}\nspace: left-posterior-superior\nspace directions: {directions}\nspace origin: (1,2,3)\n"
    shape = f"dimension: {stored.ndim}\nsizes: {sizes}"
    head = f"NRRD0004\ntype: short\n{shape}\nendian: little\nencoding: {encoding}\n{fields}\n"
    data = stored.tobytes()
    path.write_bytes(head.encode() + (gzip.compress(data) if encoding == "gzip" else data))
    return path


STEPS = "(2,0,0) (0,2,0) (0,0,3)"
INTERLEAVED = np.ascontiguousarray(np.moveaxis(SERIES, 0, -1))
FILES: dict[str, Callable[[Path], Path]] = {
    "NIfTI": lambda d: by_simple_itk(d / "series.nii"),
    "NIfTI, gzip": lambda d: by_simple_itk(d / "series.nii.gz"),
    "NIfTI pair": lambda d: by_simple_itk(d / "series.hdr"),
    "MetaImage": lambda d: by_simple_itk(d / "series.mha"),
    "MetaImage, zlib": lambda d: by_simple_itk(d / "series.mhd", compressed=True),
    "NRRD, time last": lambda d: nrrd(d / "a.nrrd", "kinds: space space space time", f"{STEPS} none", SERIES),
    "NRRD, list first": lambda d: nrrd(d / "b.nrrd", "kinds: list space space space", f"none {STEPS}", INTERLEAVED),
    "NRRD, gzip, list first": lambda d: nrrd(
        d / "c.nrrd", "kinds: list domain domain domain", f"none {STEPS}", INTERLEAVED, "gzip"
    ),
    "NRRD, told by the directions": lambda d: nrrd(d / "d.nrrd", "kinds: ???", f"none {STEPS}", INTERLEAVED),
}


@pytest.mark.parametrize("case", FILES)
def test_a_frame_is_chosen_by_its_number(case: str, tmp_path: Path) -> None:
    path = FILES[case](tmp_path)
    box = Box((2, 1, 1), (6, 5, 4))
    for frame in range(4):
        reader = open_volume(f"{path}#{frame}")
        description = reader.description
        assert description.geometry.dims == (7, 6, 5) and description.name == f"{path.name}#{frame}"
        np.testing.assert_array_equal(reader.read(description.geometry.box), SERIES[frame])
        got = reader.read(box)
        np.testing.assert_array_equal(got, SERIES[frame, 1:4, 1:5, 2:6])
        assert got.flags.c_contiguous
    if case.startswith("NRRD"):
        assert description.geometry.origin == (1, 2, 3) and description.geometry.spacing == (2, 2, 3)


@pytest.mark.parametrize("extension", ["nrrd", "nii", "mha", "h5"])
def test_the_volumes_of_a_series_that_itk_joins_lie_where_they_did(extension: str, tmp_path: Path) -> None:
    turned = np.array([[0.0, -1.0, 0.0], [0.8, 0.0, 0.6], [0.6, 0.0, -0.8]])
    volumes = [sitk.GetImageFromArray(one) for one in SERIES]
    for one in volumes:
        one.SetSpacing((0.5, 1.25, 3.0))
        one.SetOrigin((10.0, -20.0, 30.0))
        one.SetDirection(turned.ravel().tolist())
    path = tmp_path / f"series.{extension}"
    sitk.WriteImage(sitk.JoinSeries(volumes), str(path))
    assert "4 volumes" in refused(path)
    for frame, values in enumerate(SERIES):
        reader = open_volume(f"{path}#{'t=' if extension == 'h5' else ''}{frame}")
        told = reader.description
        np.testing.assert_array_equal(reader.read(told.geometry.box), values)
        for index in ((0, 0, 0), (6, 0, 0), (1, 2, 4)):
            place = told.geometry.physical((float(index[0]), float(index[1]), float(index[2])))
            expected = volumes[0].TransformIndexToPhysicalPoint(index)
            assert place == pytest.approx(expected, rel=tolerances.GEOMETRY_FLOAT32, abs=tolerances.GEOMETRY_FLOAT32)
        assert told.unit == ("" if extension == "nrrd" else "mm")  # which then names no space
        assert ("left and right cannot be told" in str(told.warnings)) == (extension == "mha")


@pytest.mark.parametrize("case", FILES)
def test_a_series_asks_for_its_frame(case: str, tmp_path: Path) -> None:
    path = FILES[case](tmp_path)
    with pytest.raises(BadInput, match=f"4 volumes, numbered from 0; choose one, as in {path}#0"):
        open_volume(str(path))
    for part in ("4", "-1", "first"):
        with pytest.raises(BadInput, match=f"numbered 0 to 3; “{part}” is none of them"):
            open_volume(f"{path}#{part}")


@pytest.mark.parametrize("kind", ["quaternion", "2D-matrix", "RGBA-color"])
def test_a_component_of_what_is_no_vector_is_chosen_by_its_number(kind: str, tmp_path: Path) -> None:
    path = nrrd(tmp_path / "v.nrrd", f"kinds: {kind} space space space", f"none {STEPS}", INTERLEAVED)
    with pytest.raises(BadInput, match=f"(?i)4 components a voxel, of kind {kind}.*choose one, as in .*#0"):
        open_volume(str(path))
    reader = open_volume(f"{path}#2")
    np.testing.assert_array_equal(reader.read(reader.description.geometry.box), SERIES[2])


def test_two_axes_outside_space_are_refused(tmp_path: Path) -> None:
    path = nrrd(tmp_path / "v.nrrd", "kinds: vector space space list", "none (1,0,0) (0,1,0) none", INTERLEAVED)
    with pytest.raises(BadInput, match="axes of 4 and 5 values that are not axes of space"):
        open_volume(str(path))


@pytest.mark.parametrize("kinds", ["domain domain domain domain domain", "vector space space space space"])
def test_more_axes_of_space_than_a_series_has_are_told_as_such(kinds: str, tmp_path: Path) -> None:
    values = np.zeros((2, 3, 4, 5, 6), np.int16)
    path = nrrd(tmp_path / "v.nrrd", f"kinds: {kinds}", "", values)
    assert "a series of 6 x 5 x 4 x 3 x 2 voxels, volsplat needs one volume" in refused(path)


def test_axes_of_which_nothing_is_said_are_a_series(tmp_path: Path) -> None:
    path = nrrd(tmp_path / "v.nrrd", "content: a test", "", SERIES)
    assert "a series of 7 x 6 x 5 x 4 voxels" in refused(path)


@pytest.mark.parametrize(("kind", "what"), [("time", "volumes"), ("vector", "components")])
def test_a_series_as_text_is_refused(kind: str, what: str, tmp_path: Path) -> None:
    path = nrrd(tmp_path / "t.nrrd", f"kinds: space space space {kind}", f"{STEPS} none", SERIES, "ascii")
    assert f"holds several {what} as text, which volsplat cannot tell apart; save it as binary" in refused(f"{path}#1")


@pytest.mark.parametrize("extension", [".nii", ".nrrd", ".mha"])
def test_only_the_frame_is_read(extension: str, tmp_path: Path) -> None:
    series = np.zeros((8, 64, 64, 64), np.int16)
    path = tmp_path / f"series{extension}"
    if extension != ".nrrd":
        sitk.WriteImage(sitk.GetImageFromArray(series, isVector=False), str(path))
    else:
        nrrd(path, "kinds: space space space time", f"{STEPS} none", series)
    reader = open_volume(f"{path}#5")
    box = Box((0, 0, 8), (64, 64, 24))
    before = bytes_read()
    reader.read(box)
    assert bytes_read() - before < box.voxels * 2 + 4096
